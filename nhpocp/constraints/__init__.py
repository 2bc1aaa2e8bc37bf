"""What a plan must respect along its whole path: bounds on named quantities, and the kinds that a problem file names.

Begin with `bound`; `kind` is the contract of a kind, `registry` has one line for each.
"""

"""What a motion can cost, one file an objective, said once for every solver.

Begin with the contract in `objective`; `registry` has one line for each.
"""

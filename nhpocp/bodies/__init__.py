"""What takes up room: convex bodies with rounded rims, the obstacles of a problem file, and the distance of two.

Begin with `hull`; `distance` is the one formula that solvers differentiate, `obstacles` has one line for each kind.
"""

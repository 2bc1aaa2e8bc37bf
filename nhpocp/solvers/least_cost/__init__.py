"""What follows once the goal is reached: into every bound and to the least cost, without leaving the goal.

Begin with `least_cost`; `null_space` moves in the null space of J, `slsqp` keeps the rows of `path_rows`.
"""

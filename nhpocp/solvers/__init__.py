"""Methods that plan: the Jacobian `continuation/` with its search for `least_cost/`, and the `nlp/`.

Each is a `Solver` of `nhpocp.solution`; `workers` runs any of them in other processes.
"""

"""Laws of `nhpocp/solvers/least_cost/`."""

"""Laws of `nhpocp/solvers/`."""

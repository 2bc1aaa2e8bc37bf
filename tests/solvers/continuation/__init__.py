"""Laws of `nhpocp/solvers/continuation/`."""

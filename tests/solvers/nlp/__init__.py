"""Laws of `nhpocp/solvers/nlp/`."""

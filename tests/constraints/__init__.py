"""Laws of `nhpocp/constraints/`."""

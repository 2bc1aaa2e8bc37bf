"""Laws of `nhpocp/flow/`."""

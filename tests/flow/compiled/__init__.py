"""Laws of `nhpocp/flow/compiled/`."""

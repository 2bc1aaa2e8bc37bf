"""Laws of `nhpocp/views/`."""

"""Laws of `nhpocp/objectives/`."""

"""Laws of `nhpocp/cli/`."""

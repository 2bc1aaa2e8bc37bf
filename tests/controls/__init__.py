"""Laws of `nhpocp/controls/`."""

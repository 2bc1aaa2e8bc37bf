"""Laws of `nhpocp/systems/`."""

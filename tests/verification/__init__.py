"""Laws of `nhpocp/verification/`."""

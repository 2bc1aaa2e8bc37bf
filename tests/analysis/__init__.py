"""Laws of `nhpocp/analysis/`."""

"""Laws of `scripts/`."""

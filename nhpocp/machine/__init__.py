"""Plans on machines: what happens when a plan is run, by one that differs from the model."""

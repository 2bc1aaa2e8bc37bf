"""Plans and machines: what goes from a plan to a robot."""

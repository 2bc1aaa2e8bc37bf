"""Plans on machines: `simulation` in a physics engine, `feedback` from what is measured, `export` to controllers."""

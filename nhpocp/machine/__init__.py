"""Plans and machines: `simulation` is the machine in a physics engine, `export` what its controller reads."""

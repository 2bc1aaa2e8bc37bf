"""Plans and machines. A room a job: `simulation`, the machine in a physics engine; `export`, what its controller reads."""

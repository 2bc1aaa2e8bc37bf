"""What plans are for: the machine that is to move. A room a job: `simulation`, the machine in a physics engine."""

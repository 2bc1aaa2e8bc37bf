"""What a plan must respect along its whole path: bounds on named quantities. Begin with `bound`."""

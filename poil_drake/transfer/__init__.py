"""Transfer of a demonstration to a target scene: matchings and their references. No pydrake."""

"""Transfer of a demonstration to a target scene: matchings and references, without pydrake."""

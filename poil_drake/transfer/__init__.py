"""From a demonstration and a target scene to a reference trajectory. No pydrake."""

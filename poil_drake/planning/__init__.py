"""Motion planning for joint positions and poses, without pydrake."""

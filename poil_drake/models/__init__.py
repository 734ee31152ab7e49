"""Models of robot, objects and fixtures, their generators, and the package's scenarios."""

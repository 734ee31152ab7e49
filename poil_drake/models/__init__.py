"""Models of the robot, objects and fixtures, their generators, and the package's scenarios."""

"""Simulated demonstrations: the scene without the robot, the object's motion, the recorder."""

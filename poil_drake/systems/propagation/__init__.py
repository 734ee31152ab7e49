"""Propagation of tracked points with the arm's forward kinematics."""

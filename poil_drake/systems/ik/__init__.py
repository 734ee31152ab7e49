"""Differential inverse kinematics."""

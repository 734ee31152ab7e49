"""Calibration of the cameras' poses, and checks of their depth."""

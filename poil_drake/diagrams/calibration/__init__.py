"""Calibration of a scenario's cameras, and checks of their depth."""

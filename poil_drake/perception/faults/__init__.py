"""Faults of cameras, scenes and calibrations, as data, and their injection into images."""

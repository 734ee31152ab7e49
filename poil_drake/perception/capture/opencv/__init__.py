"""Cameras that OpenCV opens."""

"""Cameras, images, part detectors and point trackers. No pydrake."""

"""Demonstration files: their writer, their reader and their playback as a camera."""

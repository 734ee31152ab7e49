"""Cameras that OpenCV opens: a colour and a depth source, live or from files."""

"""Aligns the tracker's object model to camera views."""

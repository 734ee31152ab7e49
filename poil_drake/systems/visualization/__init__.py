"""Draws the skill in Meshcat: points, reference, twist, and text in front of the scene."""

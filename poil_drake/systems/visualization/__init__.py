"""Draws the skill in Meshcat."""

"""Boxes and clicks that a person draws on images, and the detector that uses them."""

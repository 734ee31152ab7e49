"""Finds an object of known shape, such as the one that a demonstration showed."""

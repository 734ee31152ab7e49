"""Runs independent trials side by side."""

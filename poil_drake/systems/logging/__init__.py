"""Writes what happens in the loop to a run log."""

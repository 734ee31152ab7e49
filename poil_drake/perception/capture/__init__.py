"""Cameras that are read in this process, each on a thread of its own."""

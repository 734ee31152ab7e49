"""Compares two runs that had the same inputs."""

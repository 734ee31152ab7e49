"""Compares a run with its replay, which had the same inputs."""

"""Comparison of a run and its replay, which had the same inputs."""

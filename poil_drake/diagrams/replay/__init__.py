"""Replays a recorded run."""

"""Runs independent trials in parallel."""

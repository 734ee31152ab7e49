"""Demonstrations and run logs as MCAP. No pydrake."""

"""Demonstrations and run logs, recorded as MCAP; nothing here imports pydrake."""

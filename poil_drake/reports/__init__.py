"""Summaries, pictures and progress bars for users: no diagrams."""

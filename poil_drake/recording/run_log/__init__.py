"""Logs of runs: their writer, their reader and what a replay needs of them."""

"""Run logs: their writer, their reader, and the contents that a replay needs."""

"""Reads and writes MCAP files and the messages in them."""

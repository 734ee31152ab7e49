"""MCAP files and the messages in them."""

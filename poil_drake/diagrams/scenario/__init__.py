"""Scenarios: their schema, and how to read, check, randomize and write them."""

"""Scenarios: their schema, and how they are read, checked, drawn and written."""

"""Simulated demonstrations."""

"""Durations and periods of control ticks."""

"""Measures the durations and periods of control ticks."""

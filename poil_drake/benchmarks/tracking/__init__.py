"""Compares point trackers on rendered sequences with known truth, with and without faults."""

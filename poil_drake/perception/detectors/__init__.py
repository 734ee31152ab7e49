"""Detectors of an object and its functional part, which share one protocol."""

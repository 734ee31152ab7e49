"""Detectors that find objects and parts by their names, with a learned model."""

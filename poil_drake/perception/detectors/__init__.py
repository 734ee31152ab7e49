"""Part detectors that share one protocol."""

"""Part detectors behind one protocol."""

"""The station of the real robot: LCM, capture threads, checks."""

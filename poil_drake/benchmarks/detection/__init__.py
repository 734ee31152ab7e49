"""How often detectors find an object and its part in random scenes, and refuse when they should."""

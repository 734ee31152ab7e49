"""The real robot's station."""

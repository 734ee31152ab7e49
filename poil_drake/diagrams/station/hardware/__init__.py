"""The real robot's station, and checks of scenarios for it."""

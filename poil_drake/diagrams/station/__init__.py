"""Stations: simulated, hardware, replay, and the simulated driver."""

"""Stations for simulation, hardware and replay, and a simulated robot behind its driver."""

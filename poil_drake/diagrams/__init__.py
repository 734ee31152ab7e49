"""Scenario schema, station, closed loop."""

"""The closed loop around a station."""

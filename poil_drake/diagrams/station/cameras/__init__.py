"""The cameras of a station."""

"""The FK propagator."""

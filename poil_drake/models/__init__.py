"""Robot, objects, fixtures and scenarios."""

"""The safety supervisor."""

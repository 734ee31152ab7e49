"""The part detector."""

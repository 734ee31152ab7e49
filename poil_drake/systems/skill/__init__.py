"""The skill's state machine, and requests to stop."""

"""The phases of the skill, and requests to stop."""

"""Pictures, figures and progress for people. No diagrams."""

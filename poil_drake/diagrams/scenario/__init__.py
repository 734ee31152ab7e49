"""The scenario: its schema, and how it is read and checked."""

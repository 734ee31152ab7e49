"""The theory of the field beside simulation."""

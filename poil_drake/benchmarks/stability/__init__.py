"""The theory of the field, compared with simulation."""

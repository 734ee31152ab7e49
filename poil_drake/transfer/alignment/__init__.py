"""Coarse alignment of a demonstrated part with a target part (POIL, section III-A)."""

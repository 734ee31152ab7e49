"""Non-rigid registration of aligned parts (POIL, section III-A)."""

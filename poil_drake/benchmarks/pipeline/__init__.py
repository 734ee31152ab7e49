"""The main job over many random trials."""

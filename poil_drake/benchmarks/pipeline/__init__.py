"""The main job over many randomised trials."""

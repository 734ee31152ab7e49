"""Many random trials of `poil run`."""

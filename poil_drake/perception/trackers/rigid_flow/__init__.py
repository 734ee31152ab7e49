"""The default point tracker: aligns a growing model of the object to each frame."""

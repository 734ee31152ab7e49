"""Point trackers behind one protocol."""

"""Point trackers that share one protocol."""

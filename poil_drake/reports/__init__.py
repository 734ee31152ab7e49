"""Reports of runs and replays, progress bars, and the doctor. Nothing here builds diagrams."""

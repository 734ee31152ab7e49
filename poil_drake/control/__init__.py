"""Reference trajectories, Point-set BCSDM and its stability tools. No pydrake."""

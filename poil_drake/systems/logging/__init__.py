"""Systems that log a run of the closed loop and keep snapshots of it."""

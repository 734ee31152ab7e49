"""The control study: stable point-set control and its rivals on four tasks with contact."""

"""The control study: stable point-set control and its baselines on four tasks with contact."""

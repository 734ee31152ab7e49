"""Plans, executes and reports a run."""

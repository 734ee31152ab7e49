"""Plans, executes and reports a run of the skill, in simulation or on hardware."""

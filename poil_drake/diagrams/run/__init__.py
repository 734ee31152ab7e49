"""Plans and executes runs of the skill, in simulation or on hardware, and reports on them."""

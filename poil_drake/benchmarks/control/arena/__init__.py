"""The simulation and the tasks of the control study."""

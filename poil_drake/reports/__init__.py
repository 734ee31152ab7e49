"""The reports of runs and replays (figures and picture), progress bars, the doctor: no diagrams."""

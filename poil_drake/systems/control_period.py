"""The default control period."""

CONTROL_PERIOD = 1 / 256
"""Default period of the systems of the control loop [s]; exact in binary, so that
simultaneous events stay simultaneous."""

"""The default control period."""

CONTROL_PERIOD = 1 / 256
"""Default period of the control loop's systems [s]. As a power of two, it has exact multiples in
floating point, so events of one instant have exactly the same time."""

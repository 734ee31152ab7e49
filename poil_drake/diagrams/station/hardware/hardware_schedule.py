"""When work is done within a control period on hardware, as fractions of the period.

When a period begins, messages are handled and the command is computed. `RealTimeLoop` then waits
until the command is due. Afterwards, images are captured and signals are logged.
"""

COMMAND_SHARE = 3 / 4
"""Fraction of the period after which the command goes out. Updates nearly always end before."""

IMAGES_SHARE = 7 / 8
"""Fraction of the period after which images are captured."""

"""When work is done within a control period on hardware, as fractions of the period.

At the period's beginning, messages are handled and the command is computed. `RealTimeLoop` then
waits until the command is due, so that commands go out at an even pace. Afterwards, images are
captured and signals are logged.
"""

COMMAND_SHARE = 3 / 4
"""When the command goes out. The loop's updates nearly always end earlier."""

IMAGES_SHARE = 7 / 8
"""When images are captured."""

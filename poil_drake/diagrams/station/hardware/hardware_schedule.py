"""When work is done within a control period on hardware, as fractions of the period.

At its beginning, messages are handled and the command is computed. `RealTimeLoop` then waits until
the command is due, so that commands go out at an even pace. Work that nothing waits for follows:
images are captured, and signals are logged.
"""

COMMAND_SHARE = 3 / 4
"""When the command goes out: updates of the loop hardly ever take that long."""

IMAGES_SHARE = 7 / 8
"""When images are captured."""

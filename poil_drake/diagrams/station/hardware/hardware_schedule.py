"""When things happen within a control period on hardware, as shares of it.

At its beginning messages are handled and everything is computed. `RealTimeLoop` then waits until
the command is due, so that commands go out at an even pace. Work that nothing waits for follows:
images are captured, and signals are logged.
"""

COMMAND_SHARE = 3 / 4
"""When the command goes out: hardly any update of the loop takes as long."""

IMAGES_SHARE = 7 / 8
"""When images are captured."""

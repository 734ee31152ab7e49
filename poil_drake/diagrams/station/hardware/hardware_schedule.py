"""When things happen within a control period on hardware, as shares of it.

At its beginning messages are taken in and all is computed. `RealTimeLoop` then waits until the
command is due: however long the computing took, commands go out at an even pace. What nobody waits
for follows: images are looked at, and signals are logged.
"""

COMMAND_SHARE = 3 / 4
"""The command goes out so much later: hardly any update of the loop takes as long."""

IMAGES_SHARE = 7 / 8
"""Images are looked at then."""

"""Turns the times of a camera's library into times of our clock."""

import time

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.device import Clock

_LARGEST_OFFSET = 1.0
"""How far a stamp may be from now [s]. What is farther off does not come from this clock."""


class HostStamps:
    """Converts stamps by this computer's clock (`time.time`), one camera's in their order.

    With `time.time` itself as our clock a stamp stays as it is. With another clock, e.g. a scaled
    one, an image is as old by our clock as it is by the computer's.
    """

    def __init__(self, clock: Clock, *, source: str, host_clock: Clock = time.time):
        """Makes a converter.

        Args:
            clock: Our clock.
            source: What to call the camera in an error.
            host_clock: The clock that the stamps are from.
        """
        self._clock, self._source, self._host_clock = clock, source, host_clock
        self._last = float("-inf")

    def restart(self) -> None:
        """Forgets the last stamp, as after a pause in which the clock may have been set."""
        self._last = float("-inf")

    def convert(self, stamp: float) -> float | None:
        """Returns a stamp by our clock [s], or None where it is no later than the one before.

        A camera that is frozen may deliver the same image again and again. It is known by its
        stamp before that is converted, since two conversions differ by microseconds.

        Raises:
            CaptureError: if the stamp is not finite, or more than a second from now.
        """
        age = self._host_clock() - stamp
        if not abs(age) <= _LARGEST_OFFSET:
            raise CaptureError(
                f"{self._source} stamps an image {stamp:.3f} s, which is {age:.3f} s before this "
                "computer's time.",
                remedy="Let no other program set the computer's clock while cameras run, and "
                "unplug the camera and plug it in again.",
            )
        if stamp <= self._last:
            return None
        self._last = stamp
        return stamp if self._clock is self._host_clock else self._clock() - max(age, 0.0)

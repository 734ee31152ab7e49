"""Converts the stamps of a camera's library to our clock."""

import math
import time

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.device import Clock

_LARGEST_OFFSET = 1.0
"""Largest difference between a stamp and now [s]. Beyond it, the image is useless or the clock is a
different one."""

_MAX_OLD = 30
"""After a stall, a library delivers at most the 16 images of its queue, so this many old stamps in
a row mean a wrong clock."""


class HostStamps:
    """Converts stamps of this computer's clock (`time.time`), in the order of one camera's images.

    If our clock is that clock, a stamp is unchanged. If it is another clock, e.g. a scaled one, an
    image is as old by our clock as by the computer's.
    """

    def __init__(self, clock: Clock, *, source: str, host_clock: Clock = time.time):
        """Constructs a converter.

        Args:
            clock: Our clock.
            source: What to call the camera in an error.
            host_clock: The clock of the stamps.
        """
        self._clock, self._source, self._host_clock = clock, source, host_clock
        self.restart()

    def restart(self) -> None:
        """Forgets the last stamp, for use after a pause in which the clock may have been set."""
        self._last, self._old = -math.inf, 0

    def now(self) -> float:
        """Returns the current time by the clock of the stamps [s]."""
        return self._host_clock()

    def convert(self, stamp: float) -> float | None:
        """Returns a stamp by our clock [s], or None if the image is useless.

        An image is useless if its stamp is not later than the last one: a frozen camera may deliver
        the same image repeatedly. (Stamps are compared before conversion, since conversions of the
        same stamp differ by microseconds.) It is also useless if it is more than a second old, as
        after a halt of this program.

        Raises:
            CaptureError: if the stamp is not finite or more than a second in the future, or if 30
                in a row are too old.
        """
        age = self._host_clock() - stamp
        if not (math.isfinite(stamp) and age >= -_LARGEST_OFFSET):
            raise self._off(stamp, age)
        if stamp <= self._last:
            return None
        if age > _LARGEST_OFFSET:
            self._old += 1
            if self._old >= _MAX_OLD:
                raise self._off(stamp, age)
            return None
        self._last, self._old = stamp, 0
        return stamp if self._clock is self._host_clock else self._clock() - max(age, 0.0)

    def _off(self, stamp: float, age: float) -> CaptureError:
        return CaptureError(
            f"{self._source} stamps an image {stamp:.3f} s, which is {age:.3f} s before this "
            "computer's time.",
            remedy="Make sure that no program sets the computer's clock while cameras run, and "
            "unplug the camera and plug it in again.",
        )

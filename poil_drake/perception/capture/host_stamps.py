"""Turns the times of a camera's library into times of our clock."""

import math
import time

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.device import Clock

_LARGEST_OFFSET = 1.0
"""How far a stamp may be from now [s]. What is farther off is of no use, or of another clock."""

_MOST_OLD = 30
"""So many stamps in a row that are too old are not a stall any more, after which a library hands
over what waited in its queue, 16 images at most, but a clock that is off."""


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
        self.restart()

    def restart(self) -> None:
        """Forgets the last stamp, as after a pause in which the clock may have been set."""
        self._last, self._old = -math.inf, 0

    def now(self) -> float:
        """Returns the time by the clock that the stamps are from [s]."""
        return self._host_clock()

    def convert(self, stamp: float) -> float | None:
        """Returns a stamp by our clock [s], or None where it is of no use.

        That is one that is no later than the one before: a camera that is frozen may deliver the
        same image again and again. It is known by its stamp before that is converted, since two
        conversions differ by microseconds. And it is one from more than a second ago, as after this
        program was halted; the age of the last image tells already what that means.

        Raises:
            CaptureError: if the stamp is not finite or more than a second in the future, or if 30
                in a row were too old.
        """
        age = self._host_clock() - stamp
        if not (math.isfinite(stamp) and age >= -_LARGEST_OFFSET):
            raise self._off(stamp, age)
        if stamp <= self._last:
            return None
        if age > _LARGEST_OFFSET:
            self._old += 1
            if self._old >= _MOST_OLD:
                raise self._off(stamp, age)
            return None
        self._last, self._old = stamp, 0
        return stamp if self._clock is self._host_clock else self._clock() - max(age, 0.0)

    def _off(self, stamp: float, age: float) -> CaptureError:
        return CaptureError(
            f"{self._source} stamps an image {stamp:.3f} s, which is {age:.3f} s before this "
            "computer's time.",
            remedy="Let no other program set the computer's clock while cameras run, and unplug "
            "the camera and plug it in again.",
        )

"""Converts the stamps of a camera's library to the clock of the caller."""

import math
import time

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.device import Clock

_LARGEST_OFFSET = 1.0
"""Largest difference between a stamp and now [s]. If it is larger, the image is too old, or its
stamp is from another clock."""

_MAX_OLD = 30
"""This many old stamps in a row mean a wrong clock. After a stall, a library delivers at most the
16 images of its queue."""


class HostStamps:
    """Converts the stamps of one camera, made by this computer's clock, to those of `clock`.

    If `clock` is the computer's clock, stamps are unchanged. If `clock` is another clock, e.g. a
    scaled one, an image has the same age by `clock` as by the computer's clock.
    """

    def __init__(self, clock: Clock, *, source: str, host_clock: Clock = time.time):
        """Constructs a converter.

        Args:
            clock: The clock of the converted stamps.
            source: The camera's name in errors.
            host_clock: The computer's clock, which made the stamps.
        """
        self._clock, self._source, self._host_clock = clock, source, host_clock
        self.restart()

    def restart(self) -> None:
        """Forgets the last stamp. Call this after a pause in which a clock may have been reset."""
        self._last, self._old = -math.inf, 0

    def convert(self, stamp: float) -> float | None:
        """Returns a stamp converted to `clock` [s], or None if the image is useless.

        An image is useless if its stamp is not later than the last one: a frozen camera may repeat
        an image. An image is also useless if it is more than a second old, e.g. because this
        program was suspended.

        Args:
            stamp: The stamp of an image [s, by `host_clock`].

        Raises:
            CaptureError: if the stamp is not finite or more than a second in the future, or if it
                is the 30th stamp in a row that is too old.
        """
        age = self._host_clock() - stamp
        if not (math.isfinite(stamp) and age >= -_LARGEST_OFFSET):
            raise self._off(stamp, age)
        # Conversions of the same stamp differ by microseconds, so compare before conversion.
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
            f"{self._source} stamped an image with {stamp:.3f} s, which is {abs(age):.3f} s "
            f"{'before' if age > 0.0 else 'after'} this computer's time.",
            remedy="Make sure that no program sets the computer's clock while cameras run, then "
            "unplug the camera and plug it in again.",
        )

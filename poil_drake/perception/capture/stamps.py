"""Determines when images were captured, from the stamps of a camera's library."""

import math
import time
from typing import Any

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.device import Clock

_host_clock: Clock = time.time
"""This computer's clock, by which the libraries stamp images."""

_LARGEST_OFFSET = 1.0
"""Largest difference between a stamp and now [s]. If it is larger, the image is too old, or its
stamp is from another clock."""

_MAX_OLD = 30
"""This many old stamps in a row mean a wrong clock. After a stall, a library delivers at most the
16 images of its queue."""

_LARGEST_GAP = 0.6
"""Longest time between the two frames of a pair [periods]. The nearest frames of unsynchronized
sensors are up to half a period apart; 0.1 is for jitter of the stamps."""


class HostStamps:
    """Converts the stamps of one camera, made by this computer's clock, to those of `clock`.

    If `clock` is the computer's clock, stamps are unchanged. If `clock` is another clock, e.g. a
    scaled one, an image has the same age by `clock` as by the computer's clock.
    """

    def __init__(self, clock: Clock, *, source: str):
        """Constructs a converter.

        Args:
            clock: The clock of the converted stamps.
            source: The camera's name in errors.
        """
        self._clock, self._source = clock, source
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
            stamp: The stamp of an image [s, by this computer's clock].

        Raises:
            CaptureError: if the stamp is not finite or more than a second in the future, or if it
                is the 30th stamp in a row that is too old.
        """
        age = _host_clock() - stamp
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
        return stamp if self._clock is _host_clock else self._clock() - max(age, 0.0)

    def _off(self, stamp: float, age: float) -> CaptureError:
        return CaptureError(
            f"{self._source} stamped an image with {stamp:.3f} s, which is {abs(age):.3f} s "
            f"{'before' if age > 0.0 else 'after'} this computer's time.",
            remedy="Make sure that no program sets the computer's clock while cameras run, then "
            "unplug the camera and plug it in again.",
        )


class FramePairStamps:
    """Stamps pairs of a colour and a depth frame, and rejects pairs that are not new.

    With each new frame, the library's pipeline repeats the last frame of the other stream. A pair
    is therefore new only if both frames are newer than those of the last accepted pair. The time
    of a pair is that of its older frame.

    The time of a frame depends on the library's time domain. `global_time` is the time of capture
    by this computer's clock. `system_time` is the time of arrival. `hardware_clock` is the camera's
    clock, shifted so that the frame with the shortest delay so far gets its time of arrival. In the
    last two domains, the latency is subtracted. A frame that is fetched late keeps its time.
    """

    def __init__(self, rs: Any, clock: Clock, *, source: str, fps: float, latency: float):
        """Constructs a stamper that has seen no frames.

        Args:
            rs: The module `pyrealsense2`.
            clock: The clock of the returned stamps.
            source: The camera's name in errors.
            fps: Frames per second.
            latency: Time from a capture to the frame's arrival [s].
        """
        self._domains = rs.timestamp_domain
        self._largest_gap, self._latency = _LARGEST_GAP / fps, latency
        self._stamps = HostStamps(clock, source=source)
        self.restart()

    def restart(self) -> None:
        """Forgets all frames. Call this when the camera is opened."""
        self._stamps.restart()
        self._taken = (-1, -1)
        self._offset, self._hardware_time = math.inf, -math.inf

    def stamp(self, frames: Any) -> float | None:
        """Returns when a pair was captured [s, by `clock`], or None if the pair is unusable.

        A pair is unusable if a frame is missing or not new, if its frames have different time
        domains or times too far apart, or if `HostStamps.convert` rejects the pair's time.

        Args:
            frames: What the library's pipeline delivers, an `rs.composite_frame`.

        Raises:
            CaptureError: if the time is from a wrong clock; see `HostStamps.convert`.
        """
        if not frames:  # At a timeout.
            return None
        color, depth = frames.get_color_frame(), frames.get_depth_frame()
        if not (color and depth):  # The first frames have no partners.
            return None
        numbers = (color.get_frame_number(), depth.get_frame_number())
        if any(number <= taken for number, taken in zip(numbers, self._taken, strict=True)):
            return None
        domain = color.get_frame_timestamp_domain()
        if depth.get_frame_timestamp_domain() != domain:
            return None
        times = [frame.get_timestamp() * 1e-3 for frame in (color, depth)]
        if abs(times[0] - times[1]) > self._largest_gap:
            return None
        time = min(times)
        if domain == self._domains.hardware_clock:
            time += self._hardware_offset(time)
        stamp = self._stamps.convert(time)
        if stamp is None:
            return None
        self._taken = numbers
        return stamp if domain == self._domains.global_time else stamp - self._latency

    def _hardware_offset(self, time: float) -> float:
        """Returns the offset from the camera's clock to the computer's [s] after a frame at `time`.

        The offset never increases. If the camera's clock is slow by 50 ppm, images therefore look
        0.2 s too old after an hour. The offset restarts when the clock wraps, every 72 minutes.
        """
        if time < self._hardware_time:
            self._offset = math.inf
        self._hardware_time = time
        self._offset = min(self._offset, _host_clock() - time)
        return self._offset

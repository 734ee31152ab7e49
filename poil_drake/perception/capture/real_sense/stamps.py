"""Determines when a RealSense captured a pair of frames, and whether the pair is new."""

import math
from typing import Any

from poil_drake.perception.capture.device import Clock
from poil_drake.perception.capture.host_stamps import HostStamps

_SECONDS_PER_MILLISECOND = 1e-3

_LARGEST_GAP = 0.6
"""Longest time between the two frames of a pair [periods]. The nearest frames of unsynchronized
sensors are up to half a period apart; 0.1 is for jitter of the stamps."""


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

    def __init__(
        self, rs: Any, clock: Clock, *, source: str, fps: float, latency: float, host_clock: Clock
    ):
        """Constructs a stamper that has seen no frames.

        Args:
            rs: The module `pyrealsense2`.
            clock: The clock of the returned stamps.
            source: The camera's name in errors.
            fps: Frames per second.
            latency: Time from a capture to the frame's arrival [s].
            host_clock: This computer's clock, by which the library stamps frames.
        """
        self._domains = rs.timestamp_domain
        self._largest_gap, self._latency = _LARGEST_GAP / fps, latency
        self._host_clock = host_clock
        self._stamps = HostStamps(clock, source=source, host_clock=host_clock)
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
        times = [frame.get_timestamp() * _SECONDS_PER_MILLISECOND for frame in (color, depth)]
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
        self._offset = min(self._offset, self._host_clock() - time)
        return self._offset

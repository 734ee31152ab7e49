"""When a RealSense took a pair of frames, and whether it is new."""

import math
from typing import Any

from poil_drake.perception.capture.device import Clock
from poil_drake.perception.capture.host_stamps import HostStamps

_SECONDS_PER_MILLISECOND = 1e-3

_LARGEST_GAP = 0.6
"""Between the two frames of a pair [periods]: of two cameras out of step the nearest frames are up
to half a period apart, and stamps tremble a little."""


class FramePairStamps:
    """Stamps pairs of a colour and a depth frame, and refuses those that are not new.

    The library's pipeline gives with every new frame the last one of the other stream once more, so
    a pair is new only where both frames are. Both are compared with those of the last pair that was
    taken, since the two may come one after the other. The pair's time is that of the older frame.

    The time of a frame is, by its time domain: of `global_time`, the capture by this computer's
    clock; of `system_time`, when the frame arrived; of `hardware_clock`, the camera's own, whose
    offset is that of the frame that came fastest since the start. For the latter two the latency is
    taken off. Whoever asks late thus finds an old frame old.
    """

    def __init__(
        self,
        rs: Any,
        clock: Clock,
        *,
        source: str,
        fps: float,
        latency: float,
        host_clock: Clock,
    ):
        """Makes it.

        Args:
            rs: The module `pyrealsense2`.
            clock: Our clock.
            source: What to call the camera in an error.
            fps: Frames per second.
            latency: From a capture to the frame's arrival [s].
            host_clock: This computer's, by which the library stamps.
        """
        self._domains = rs.timestamp_domain
        self._largest_gap, self._latency = _LARGEST_GAP / fps, latency
        self._stamps = HostStamps(clock, source=source, host_clock=host_clock)
        self.restart()

    def restart(self) -> None:
        """Forgets all frames, as after the camera was opened."""
        self._stamps.restart()
        self._taken = (-1, -1)
        self._offset, self._hardware_time = math.inf, -math.inf

    def stamp(self, color: Any, depth: Any) -> float | None:
        """Returns when a pair was taken by our clock [s], or None where it is not new, or no pair.

        Raises:
            CaptureError: see `HostStamps.convert`.
        """
        numbers = (color.get_frame_number(), depth.get_frame_number())
        if any(number <= taken for number, taken in zip(numbers, self._taken, strict=True)):
            return None
        domain = color.get_frame_timestamp_domain()
        if depth.get_frame_timestamp_domain() != domain:
            return None
        times = [frame.get_timestamp() * _SECONDS_PER_MILLISECOND for frame in (color, depth)]
        if abs(times[0] - times[1]) > self._largest_gap:
            return None
        stamp = self._convert(min(times), domain)
        if stamp is not None:
            self._taken = numbers
        return stamp

    def _convert(self, time: float, domain: Any) -> float | None:
        if domain == self._domains.global_time:
            return self._stamps.convert(time)
        if domain == self._domains.hardware_clock:
            time += self._hardware_offset(time)
        stamp = self._stamps.convert(time)
        return None if stamp is None else stamp - self._latency

    def _hardware_offset(self, time: float) -> float:
        """Returns what makes a time of the camera's clock one of ours [s].

        It only becomes smaller; a clock that goes wrong by 50 ppm is 0.2 s off after an hour, and
        images look older then. A clock that begins again, after 72 minutes, has a new offset.
        """
        if time < self._hardware_time:
            self._offset = math.inf
        self._hardware_time = time
        self._offset = min(self._offset, self._stamps.now() - time)
        return self._offset

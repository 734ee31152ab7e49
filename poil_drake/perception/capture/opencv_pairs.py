"""Reads pairs of a colour and a depth image from two open sources: two files or two live ones."""

import threading
import time
from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.errors import CaptureError, NoMoreImagesError
from poil_drake.perception.capture.config import OpenCvStreams
from poil_drake.perception.capture.device import PATIENCE, Clock
from poil_drake.runtime.interpreter_turns import TURNS

_JOIN_TIMEOUT = 1.0
"""How long `LiveSource.stop` waits for its thread [s]. A source may block the thread for longer."""


@dataclass(frozen=True, eq=False)
class Arrival:
    """An image as OpenCV delivers it, and its time of arrival [s, by the device's clock]."""

    pixels: np.ndarray
    time: float


class FilePair:
    """Reads pairs of images from two files at the configured rate."""

    def __init__(
        self, captures: list[cv2.VideoCapture], config: OpenCvStreams, *, camera: str, clock: Clock
    ):
        """Takes over two open files.

        Args:
            captures: The colour and the depth file.
            config: How to read them.
            camera: The camera's name in the scenario.
            clock: Returns the current time [s since the epoch].
        """
        self._captures, self._config, self._clock = captures, config, clock
        self._source = f"Camera '{camera}'"
        self._due, self._ended = clock(), False

    def read(self) -> tuple[Arrival, Arrival] | None:
        """Waits at most PATIENCE for the next pair of a colour and a depth image.

        Returns:
            The pair, or None if it is not due yet.

        Raises:
            NoMoreImagesError: if a file has no more images.
        """
        ahead = PATIENCE if self._ended else self._due - self._clock()
        if ahead > 0.0:
            time.sleep(min(ahead, PATIENCE))
        now = self._clock()
        if now < self._due:
            return None
        if not self._ended:  # OpenCV logs a warning at each read beyond the end.
            (rgb_came, rgb), (depth_came, depth) = (capture.read() for capture in self._captures)
            if rgb_came and depth_came:
                self._due = max(self._due + 1.0 / self._config.fps, now)
                now = self._clock()
                return Arrival(rgb, now), Arrival(depth, now)
            self._ended = True
        raise NoMoreImagesError(
            f"{self._source}: '{self._config.rgb}' or '{self._config.depth}' has no more images.",
            remedy="Use longer files.",
        )

    def close(self) -> None:
        """Releases both files."""
        for capture in self._captures:
            capture.release()


class LiveSource:
    """Reads a source on its own thread and keeps the newest image.

    Without the thread, a source that delivers faster than it is read would queue ever older images.
    The time of an image is when it was fetched from its driver. If this program has been suspended,
    the few images that waited in the driver therefore look newer than they are.

    Attributes:
        newest: The newest image; None before the first.
        ended: Whether no more images will come.
    """

    def __init__(
        self, capture: cv2.VideoCapture, *, name: str, clock: Clock, changed: threading.Condition
    ):
        """Starts the thread.

        Args:
            capture: The open source. From now on only the thread uses it. The thread releases the
                source when it ends.
            name: Name of the source, for the name of the thread.
            clock: Returns the current time [s since the epoch].
            changed: Condition to notify of each new image and of the end.
        """
        self.newest: Arrival | None = None
        self.ended = False
        self._capture, self._clock, self._changed = capture, clock, changed
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"grab_{name}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Tells the thread to end. A thread that its source blocks may end later."""
        self._stopped.set()
        self._thread.join(_JOIN_TIMEOUT)

    def _run(self) -> None:
        try:
            while not self._stopped.is_set() and self._capture.grab():
                arrival = self._clock()
                TURNS.wait()
                came, pixels = self._capture.retrieve()
                if came:
                    with self._changed:
                        self.newest = Arrival(pixels, arrival)
                        self._changed.notify_all()
        finally:
            self._capture.release()
            with self._changed:
                self.ended = True
                self._changed.notify_all()


class LivePair:
    """Reads two live sources, each on its own thread, and pairs images that arrive together."""

    def __init__(
        self, captures: list[cv2.VideoCapture], config: OpenCvStreams, *, camera: str, clock: Clock
    ):
        """Takes over two open live sources. The arguments are those of `FilePair`."""
        self._config, self._clock, self._source = config, clock, f"Camera '{camera}'"
        self._changed = threading.Condition()
        self._sources = [
            LiveSource(capture, name=f"{kind}_{camera}", clock=clock, changed=self._changed)
            for kind, capture in zip(("rgb", "depth"), captures, strict=True)
        ]
        self._taken: tuple[Arrival | None, ...] = (None, None)
        self._last_time = clock()
        self._settled = self._last_time + config.settle

    def read(self) -> tuple[Arrival, Arrival] | None:
        """Waits at most PATIENCE for a new pair of images that arrived together.

        Returns:
            The pair, or None if there is no new pair or the exposure still adapts.

        Raises:
            CaptureError: if a source has ended, or if no new pair came for `silence` seconds.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._new_pair() or self._ended(), PATIENCE)
            pair, ended = self._new_pair(), self._ended()
        now = self._clock()
        if pair is None:
            if ended or now - self._last_time > self._config.silence:
                raise self._gone(ended, now)
            return None
        self._taken, self._last_time = pair, now
        return pair if now >= self._settled else None

    def close(self) -> None:
        """Stops both threads, which release their sources."""
        for source in self._sources:
            source.stop()

    def _new_pair(self) -> tuple[Arrival, Arrival] | None:
        rgb, depth = (source.newest for source in self._sources)
        if rgb is None or depth is None or rgb is self._taken[0] or depth is self._taken[1]:
            return None
        return (rgb, depth) if abs(rgb.time - depth.time) <= self._config.largest_gap else None

    def _ended(self) -> bool:
        return any(source.ended for source in self._sources)

    def _gone(self, ended: bool, now: float) -> CaptureError:
        ages = [
            f"'{name}': "
            + ("none" if source.newest is None else f"{now - source.newest.time:.2f} s ago")
            for name, source in zip(
                (self._config.rgb, self._config.depth), self._sources, strict=True
            )
        ]
        reason = "a source has ended" if ended else f"no new pair for {self._config.silence:g} s"
        return CaptureError(
            f"{self._source}: {reason}; last images: {', '.join(ages)}.",
            remedy="Check that both sources are plugged in or their senders are running"
            f"{'' if ended else ', and that their images arrive at most `largest_gap` apart'}.",
        )

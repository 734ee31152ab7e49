"""Pairs of a colour and a depth source of OpenCV, of files or live."""

import threading
import time
from typing import Protocol

import cv2

from poil_drake.errors import CaptureError, NoImageError
from poil_drake.perception.capture.config import OpenCvStreams
from poil_drake.perception.capture.device import PATIENCE, Clock
from poil_drake.perception.capture.opencv.live_source import Arrival, LiveSource


class OpenCvPair(Protocol):
    """Two sources that are open."""

    def read(self) -> tuple[Arrival, Arrival] | None:
        """Waits a short while for a new colour and depth image of one instant.

        Raises:
            NoImageError: if none will come any more.
            CaptureError: if the sources are gone.
        """

    def close(self) -> None:
        """Lets go of both."""


class FilePair:
    """Two files, read image by image at the rate of the configuration."""

    def __init__(
        self,
        rgb: cv2.VideoCapture,
        depth: cv2.VideoCapture,
        config: OpenCvStreams,
        *,
        camera: str,
        clock: Clock,
    ):
        """Takes the sources over.

        Args:
            rgb: The source of colour, open.
            depth: The source of depth, open.
            config: How they are read.
            camera: The camera's name in the scenario.
            clock: The time now [s since the epoch].
        """
        self._captures, self._config, self._clock = (rgb, depth), config, clock
        self._source = f"Camera '{camera}'"
        self._due, self._over = clock(), False

    def read(self) -> tuple[Arrival, Arrival] | None:
        """See `OpenCvPair.read`."""
        if self._over:
            time.sleep(PATIENCE)
            raise self._ended()
        if not self._wait():
            return None
        rgb, depth = (capture.read() for capture in self._captures)
        if not (rgb[0] and depth[0]):
            self._over = True  # OpenCV would complain of each further look.
            raise self._ended()
        now = self._clock()
        return Arrival(rgb[1], now), Arrival(depth[1], now)

    def close(self) -> None:
        """See `OpenCvPair.close`."""
        for capture in self._captures:
            capture.release()

    def _wait(self) -> bool:
        """Waits until the next image is due, or as long as a read may."""
        ahead = self._due - self._clock()
        if ahead > 0.0:
            time.sleep(min(ahead, PATIENCE))
        now = self._clock()
        if now < self._due:
            return False
        self._due = max(self._due + 1.0 / self._config.fps, now)
        return True

    def _ended(self) -> NoImageError:
        return NoImageError(
            f"{self._source}: '{self._config.rgb}' and '{self._config.depth}' have ended.",
            remedy="Take longer ones.",
        )


class LivePair:
    """Two live sources, each on a thread of its own, paired by when their images came."""

    def __init__(
        self,
        rgb: cv2.VideoCapture,
        depth: cv2.VideoCapture,
        config: OpenCvStreams,
        *,
        camera: str,
        clock: Clock,
    ):
        """Takes the sources over.

        Args:
            rgb: The source of colour, open.
            depth: The source of depth, open.
            config: How they are read.
            camera: The camera's name in the scenario.
            clock: The time now [s since the epoch].
        """
        self._config, self._clock, self._source = config, clock, f"Camera '{camera}'"
        self._changed = threading.Condition()
        self._sources = tuple(
            LiveSource(capture, name=f"{kind}_{camera}", clock=clock, changed=self._changed)
            for kind, capture in (("rgb", rgb), ("depth", depth))
        )
        self._taken: tuple[Arrival | None, ...] = (None, None)
        self._heard = clock()
        self._settled = self._heard + config.settle

    def read(self) -> tuple[Arrival, Arrival] | None:
        """See `OpenCvPair.read`."""
        with self._changed:
            self._changed.wait_for(lambda: self._new_pair() or self._ended(), PATIENCE)
            pair, ended = self._new_pair(), self._ended()
        now = self._clock()
        if pair is None:
            if ended or now - self._heard > self._config.silence:
                raise self._gone(ended)
            return None
        self._taken, self._heard = pair, now
        return pair if now >= self._settled else None

    def close(self) -> None:
        """See `OpenCvPair.close`."""
        for source in self._sources:
            source.stop()

    def _new_pair(self) -> tuple[Arrival, Arrival] | None:
        rgb, depth = (source.newest for source in self._sources)
        if rgb is None or depth is None or rgb is self._taken[0] or depth is self._taken[1]:
            return None
        return (rgb, depth) if abs(rgb.time - depth.time) <= self._config.largest_gap else None

    def _ended(self) -> bool:
        return any(source.ended for source in self._sources)

    def _gone(self, ended: bool) -> CaptureError:
        now, names = self._clock(), (self._config.rgb, self._config.depth)
        said = [
            f"'{name}' "
            + ("nothing" if source.newest is None else f"{now - source.newest.time:.2f} s ago")
            for name, source in zip(names, self._sources, strict=True)
        ]
        why = "ended" if ended else f"brought no new pair for {self._config.silence:g} s"
        return CaptureError(
            f"{self._source} {why}; the last image came from {' and from '.join(said)}.",
            remedy="See whether both are plugged in, or their senders running, and whether their "
            "images come within OpenCvStreams.largest_gap of each other.",
        )

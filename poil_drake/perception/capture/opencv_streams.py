"""Cameras that OpenCV opens: one source of colour and one of depth."""

import re
import time
from pathlib import Path

import cv2
import numpy as np

from poil_drake.errors import CaptureError, InvalidValueError
from poil_drake.perception.capture.checked_image import checked_image
from poil_drake.perception.capture.config import OpenCvStreams
from poil_drake.perception.capture.device import PATIENCE, Clock
from poil_drake.perception.images import RgbdImage

_OPEN_TIMEOUT, _READ_TIMEOUT = 5000, 1000
"""For a URL [ms]; OpenCV's own are 30 s."""

_NUMBERED = re.compile(r"%0?\d*d")
"""In a pattern of numbered images."""


class OpenCvStreamsDevice:
    """A pair of sources that are read at the same time; a `CaptureDevice`.

    At the end of a file no more images come. See `OpenCvStreams` for what the stamps mean.
    """

    def __init__(self, config: OpenCvStreams, *, camera: str, size: tuple[int, int], clock: Clock):
        """Remembers what to read; nothing is opened.

        Args:
            config: The sources.
            camera: The camera's name in the scenario.
            size: (height, width) of both images [px].
            clock: The time now [s since the epoch].

        Raises:
            InvalidValueError: if a source is missing.
        """
        for name in ("rgb", "depth"):
            if not getattr(config, name):
                raise InvalidValueError(
                    f"OpenCvStreams.{name} of camera '{camera}' is empty.",
                    remedy="Give a device number, a file, a pattern or a URL.",
                )
        self._config, self._size, self._clock = config, size, clock
        self._source = f"Camera '{camera}'"
        self._files = all(_is_file(source) for source in (config.rgb, config.depth))
        self._rgb: cv2.VideoCapture | None = None
        self._depth: cv2.VideoCapture | None = None
        self._due, self._over = 0.0, False

    def open(self) -> None:
        """See `CaptureDevice.open`."""
        self._rgb = self._opened(self._config.rgb)
        self._depth = self._opened(self._config.depth)
        # A backend that cannot do this shows it by the images that it delivers.
        self._depth.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        self._due, self._over = self._clock(), False

    def read(self) -> RgbdImage | None:
        """See `CaptureDevice.read`."""
        if self._rgb is None or self._depth is None:
            raise CaptureError(f"{self._source} is not open.", remedy="Open it first.")
        if self._over:
            time.sleep(PATIENCE)
            return None
        if self._files and not self._wait():
            return None
        came = self._rgb.grab()
        stamp = self._clock() - self._config.latency
        if not (came and self._depth.grab()):
            self._ended()
            return None
        came, bgr = self._rgb.retrieve()
        depth_came, raw = self._depth.retrieve()
        if not (came and depth_came):
            self._ended()
            return None
        return checked_image(
            self._color(bgr), self._metres(raw), stamp=stamp, size=self._size, source=self._source
        )

    def close(self) -> None:
        """See `CaptureDevice.close`."""
        for capture in (self._rgb, self._depth):
            if capture is not None:
                capture.release()
        self._rgb = self._depth = None

    def _opened(self, source: str) -> cv2.VideoCapture:
        capture = _open(source)
        if not capture.isOpened():
            raise CaptureError(
                f"{self._source}: OpenCV cannot open '{source}'.",
                remedy="Check the name, the permissions (group video), and that no other program "
                "uses it; a pipeline needs an OpenCV that was built with GStreamer.",
            )
        if not _is_file(source):
            # Newest wins: images that wait are old.
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        return capture

    def _wait(self) -> bool:
        """Waits until the next image of a file is due, or as long as a read may."""
        ahead = self._due - self._clock()
        if ahead > 0.0:
            time.sleep(min(ahead, PATIENCE))
        now = self._clock()
        if now < self._due:
            return False
        self._due = max(self._due + 1.0 / self._config.fps, now)
        return True

    def _ended(self) -> None:
        if not self._files:
            raise CaptureError(
                f"{self._source} delivers nothing any more from '{self._config.rgb}' and "
                f"'{self._config.depth}'.",
                remedy="See whether it is plugged in, or its sender running.",
            )
        self._over = True  # OpenCV would complain of each further look.

    def _color(self, bgr: np.ndarray) -> np.ndarray:
        if bgr.ndim != 3 or bgr.shape[2] != 3:
            raise CaptureError(
                f"{self._source} delivers colour of shape {bgr.shape} and type {bgr.dtype} from "
                f"'{self._config.rgb}'.",
                remedy="Give a source of colour images with 3 channels.",
            )
        return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)

    def _metres(self, raw: np.ndarray) -> np.ndarray:
        if raw.dtype != np.uint16 or raw.ndim != 2:
            raise CaptureError(
                f"{self._source} delivers depth of shape {raw.shape} and type {raw.dtype} from "
                f"'{self._config.depth}', but one channel with 16 bit is needed.",
                remedy="Use a format that OpenCV keeps as it is: Y16 of a device, GRAY16_LE of a "
                "pipeline, FFV1 gray16le in a video, or numbered 16-bit PNG files.",
            )
        return np.multiply(raw, np.float32(self._config.depth_scale), dtype=np.float32)


def _open(source: str) -> cv2.VideoCapture:
    if source.isdecimal():
        return cv2.VideoCapture(int(source))
    if " ! " in source:
        return cv2.VideoCapture(source, cv2.CAP_GSTREAMER)
    if "://" in source:
        timeouts = [
            *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_TIMEOUT),
            *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_TIMEOUT),
        ]
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG, timeouts)
    if _NUMBERED.search(source):
        # FFmpeg, which OpenCV would ask first, makes 8 bit of 16.
        return cv2.VideoCapture(source, cv2.CAP_IMAGES)
    return cv2.VideoCapture(source)


def _is_file(source: str) -> bool:
    """Returns whether a source can be read as fast as one likes."""
    if source.isdecimal() or " ! " in source or "://" in source:
        return False
    return not Path(source).is_char_device()

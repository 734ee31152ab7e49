"""An RGB-D camera that OpenCV reads as two sources: one of colour, one of depth."""

import re
from pathlib import Path

import cv2
import numpy as np

from poil_drake.errors import CaptureError, InvalidValueError, NoImageError
from poil_drake.perception.capture.checks import checked_image
from poil_drake.perception.capture.config import OpenCvStreams
from poil_drake.perception.capture.device import Clock
from poil_drake.perception.capture.opencv_pairs import FilePair, LivePair
from poil_drake.perception.images import CameraModel, RgbdImage

_TIMEOUTS = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 5000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 1000]
"""Timeouts for opening a URL and for reading an image from it [ms]. OpenCV's defaults are 30 s."""


class OpenCvStreamsDevice:
    """Reads a colour and a depth source together; a `CaptureDevice`.

    See `OpenCvStreams` for what the stamps mean. Tested with real files; live sources were tested
    only with a stand-in for `cv2.VideoCapture`.
    """

    def __init__(self, config: OpenCvStreams, *, camera: CameraModel, clock: Clock):
        """Constructs the device without opening the sources.

        Args:
            config: The two sources, and how to read them.
            camera: The camera's model in the scenario.
            clock: Returns the current time [s since the epoch].

        Raises:
            InvalidValueError: if a source is empty, or if one is a file and the other is live.
        """
        for name in ("rgb", "depth"):
            if not getattr(config, name):
                raise InvalidValueError(
                    f"OpenCvStreams.{name} of camera '{camera.name}' is empty.",
                    remedy="Set it to a device, a video, a pattern of images, a URL or a pipeline.",
                )
        if _is_file(config.rgb) != _is_file(config.depth):
            raise InvalidValueError(
                f"Camera '{camera.name}' has one file and one live source: rgb '{config.rgb}', "
                f"depth '{config.depth}'.",
                remedy="Use two files or two live sources, and check that device paths exist.",
            )
        self._config, self._camera, self._clock = config, camera, clock
        self._size = (camera.height, camera.width)
        self._source = f"Camera '{camera.name}'"
        self._pair: FilePair | LivePair | None = None

    def open(self) -> None:
        """Opens both sources; see `CaptureDevice.open`."""
        config = self._config
        rgb = self._open(config.rgb, config.rgb_fourcc)
        try:
            depth = self._open(config.depth, config.depth_fourcc)
        except CaptureError:
            rgb.release()
            raise
        # `read` rejects the images of a backend that does not support this.
        depth.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        pair = FilePair if _is_file(config.rgb) else LivePair
        self._pair = pair([rgb, depth], config, camera=self._camera.name, clock=self._clock)

    def read(self) -> RgbdImage | None:
        """Returns a new image; see `CaptureDevice.read`."""
        assert self._pair is not None, "not open"
        pair = self._pair.read()
        if pair is None:
            return None
        rgb, depth = pair
        color, steps = rgb.pixels, depth.pixels
        if steps.dtype != np.uint16 or steps.ndim != 2:
            raise NoImageError(
                f"{self._source} delivers depth of shape {steps.shape} and type {steps.dtype} from "
                f"'{self._config.depth}', but one channel of uint16 is needed.",
                remedy="Use a format that OpenCV does not convert: Y16 for a device, GRAY16_LE for "
                "a pipeline, FFV1 gray16le for a video, or numbered 16-bit PNG files.",
            )
        if color.shape[2:] == (3,):  # `checked_image` rejects all else.
            color = cv2.cvtColor(color, cv2.COLOR_BGR2RGB)
        return checked_image(
            color,
            steps,
            stamp=min(rgb.time, depth.time) - self._config.latency,
            size=self._size,
            source=self._source,
            depth_step=self._config.depth_scale,
        )

    def close(self) -> None:
        """Closes both sources; see `CaptureDevice.close`."""
        pair, self._pair = self._pair, None
        if pair is not None:
            pair.close()

    def _open(self, source: str, fourcc: str) -> cv2.VideoCapture:
        """Opens an image source with OpenCV.

        A device is asked for a size, a rate and a format. A URL or a pipeline delivers what its
        sender sends.

        Args:
            source: A source as described in `OpenCvStreams`.
            fourcc: The format to request; empty for the device's default.

        Raises:
            CaptureError: if OpenCV cannot open the source, or if a live source reports another size
                or format than requested.
        """
        capture = _opened(source)
        if not capture.isOpened():
            raise CaptureError(
                f"{self._source}: OpenCV cannot open '{source}'.",
                remedy="Check the source's name and permissions (group video), and that no other "
                "program uses it. A pipeline needs an OpenCV that was built with GStreamer.",
            )
        if _is_file(source):
            return capture
        height, width = self._size
        if not _is_stream(source):
            if fourcc:
                capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*fourcc))
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
            capture.set(cv2.CAP_PROP_FPS, self._config.fps)
        found_size = tuple(
            int(capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        found_fourcc = fourcc
        if fourcc and not _is_stream(source):
            code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
            found_fourcc = code.to_bytes(4, "little").decode("ascii", "replace")
        # A source that does not report its size is checked by its images.
        if (found_size != (width, height) and min(found_size) > 0) or found_fourcc != fourcc:
            capture.release()
            raise CaptureError(
                f"{self._source}: '{source}' delivers {found_size[0]} x {found_size[1]} pixels"
                f"{f' as {found_fourcc!r}' if fourcc else ''}, not {width} x {height}"
                f"{f' as {fourcc!r}' if fourcc else ''}.",
                remedy="Choose a size and a format that the source supports (v4l2-ctl "
                "--list-formats-ext lists them), and the calibration for that size.",
            )
        return capture


def _is_file(source: str) -> bool:
    """Returns whether a source (see `OpenCvStreams`) is a file or numbered images, not live."""
    return not (_is_stream(source) or source.isdecimal() or Path(source).is_char_device())


def _is_stream(source: str) -> bool:
    return " ! " in source or "://" in source


def _opened(source: str) -> cv2.VideoCapture:
    if source.isdecimal():
        return cv2.VideoCapture(int(source))
    if " ! " in source:
        return cv2.VideoCapture(source, cv2.CAP_GSTREAMER)
    if "://" in source:
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG, _TIMEOUTS)
    if re.search(r"%0?\d*d", source):
        # Numbered images: FFmpeg, OpenCV's first choice, would convert 16 bit to 8 bit.
        return cv2.VideoCapture(source, cv2.CAP_IMAGES)
    return cv2.VideoCapture(source)

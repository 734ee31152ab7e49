"""Cameras that OpenCV opens: one source of colour and one of depth."""

import cv2
import numpy as np

from poil_drake.errors import CaptureError, InvalidValueError, NoImageError
from poil_drake.perception.capture.checked_image import checked_image
from poil_drake.perception.capture.config import OpenCvStreams
from poil_drake.perception.capture.device import Clock
from poil_drake.perception.capture.opencv.pairs import FilePair, LivePair, OpenCvPair
from poil_drake.perception.capture.opencv.sources import configure_live, is_file, open_source
from poil_drake.perception.images import CameraModel, RgbdImage


class OpenCvStreamsDevice:
    """A pair of sources that are read at the same time; a `CaptureDevice`.

    See `OpenCvStreams` for what the stamps mean. Files were tried with real files, live sources
    with a stand-in for OpenCV's only.
    """

    def __init__(self, config: OpenCvStreams, *, camera: CameraModel, clock: Clock):
        """Remembers what to read; nothing is opened.

        Args:
            config: The sources.
            camera: The camera's model in the scenario.
            clock: The time now [s since the epoch].

        Raises:
            InvalidValueError: if a source is missing, or only one is a file.
        """
        for name in ("rgb", "depth"):
            if not getattr(config, name):
                raise InvalidValueError(
                    f"OpenCvStreams.{name} of camera '{camera.name}' is empty.",
                    remedy="Give a device number, a file, a pattern or a URL.",
                )
        if is_file(config.rgb) != is_file(config.depth):
            raise InvalidValueError(
                f"Of camera '{camera.name}' only one of '{config.rgb}' and '{config.depth}' is a "
                "file.",
                remedy="Give two files or two live sources (or see whether the device is there).",
            )
        self._config, self._clock = config, clock
        self._size, self._name = (camera.height, camera.width), camera.name
        self._source = f"Camera '{camera.name}'"
        self._pair: OpenCvPair | None = None

    def open(self) -> None:
        """See `CaptureDevice.open`."""
        config = self._config
        live = not is_file(config.rgb)
        captures: list[cv2.VideoCapture] = []
        try:
            for source, fourcc in (
                (config.rgb, config.rgb_fourcc),
                (config.depth, config.depth_fourcc),
            ):
                captures.append(open_source(source, camera=self._source))
                if live:
                    self._configure(captures[-1], source, fourcc)
        except CaptureError:
            for capture in captures:
                capture.release()
            raise
        rgb, depth = captures
        # A backend that cannot do this shows it by the images that it delivers.
        depth.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        if live:
            self._pair = LivePair(rgb, depth, config, camera=self._name, clock=self._clock)
        else:
            self._pair = FilePair(rgb, depth, config, camera=self._name, clock=self._clock)

    def read(self) -> RgbdImage | None:
        """See `CaptureDevice.read`."""
        if self._pair is None:
            raise CaptureError(f"{self._source} is not open.", remedy="Open it first.")
        pair = self._pair.read()
        if pair is None:
            return None
        rgb, depth = pair
        return checked_image(
            self._color(rgb.pixels),
            self._depth(depth.pixels),
            stamp=min(rgb.time, depth.time) - self._config.latency,
            size=self._size,
            source=self._source,
            depth_step=self._config.depth_scale,
        )

    def close(self) -> None:
        """See `CaptureDevice.close`."""
        pair, self._pair = self._pair, None
        if pair is not None:
            pair.close()

    def _configure(self, capture: cv2.VideoCapture, source: str, fourcc: str) -> None:
        configure_live(
            capture,
            source=source,
            camera=self._source,
            size=self._size,
            fps=self._config.fps,
            fourcc=fourcc,
        )

    def _color(self, bgr: np.ndarray) -> np.ndarray:
        if bgr.ndim != 3 or bgr.shape[2] != 3:
            raise NoImageError(
                f"{self._source} delivers colour of shape {bgr.shape} and type {bgr.dtype} from "
                f"'{self._config.rgb}'.",
                remedy="Give a source of colour images with 3 channels.",
            )
        return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)

    def _depth(self, raw: np.ndarray) -> np.ndarray:
        if raw.dtype != np.uint16 or raw.ndim != 2:
            raise NoImageError(
                f"{self._source} delivers depth of shape {raw.shape} and type {raw.dtype} from "
                f"'{self._config.depth}', but one channel with 16 bit is needed.",
                remedy="Use a format that OpenCV keeps as it is: Y16 of a device, GRAY16_LE of a "
                "pipeline, FFV1 gray16le in a video, or numbered 16-bit PNG files.",
            )
        return raw

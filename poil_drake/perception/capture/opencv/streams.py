"""An RGB-D camera that OpenCV reads as two sources: one of colour, one of depth."""

import cv2
import numpy as np

from poil_drake.errors import CaptureError, InvalidValueError, NoImageError
from poil_drake.perception.capture.checked_image import checked_image
from poil_drake.perception.capture.config import OpenCvStreams
from poil_drake.perception.capture.device import Clock
from poil_drake.perception.capture.opencv.pairs import FilePair, LivePair
from poil_drake.perception.capture.opencv.sources import is_file, open_source
from poil_drake.perception.images import CameraModel, RgbdImage


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
        if is_file(config.rgb) != is_file(config.depth):
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
        # `_depth` rejects the images of a backend that does not support this.
        depth.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        pair = FilePair if is_file(config.rgb) else LivePair
        self._pair = pair([rgb, depth], config, camera=self._camera.name, clock=self._clock)

    def read(self) -> RgbdImage | None:
        """Returns a new image; see `CaptureDevice.read`."""
        if self._pair is None:
            raise CaptureError(f"{self._source} is not open.", remedy="Call `open` first.")
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
        """Closes both sources; see `CaptureDevice.close`."""
        pair, self._pair = self._pair, None
        if pair is not None:
            pair.close()

    def _open(self, source: str, fourcc: str) -> cv2.VideoCapture:
        fps = self._config.fps
        return open_source(source, camera=self._source, size=self._size, fps=fps, fourcc=fourcc)

    def _color(self, bgr: np.ndarray) -> np.ndarray:
        if bgr.ndim != 3 or bgr.shape[2] != 3:
            raise NoImageError(
                f"{self._source} delivers colour of shape {bgr.shape} and type {bgr.dtype} from "
                f"'{self._config.rgb}', but 3 channels are needed.",
                remedy="Use a source that delivers colour images with 3 channels.",
            )
        return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)

    def _depth(self, raw: np.ndarray) -> np.ndarray:
        if raw.dtype != np.uint16 or raw.ndim != 2:
            raise NoImageError(
                f"{self._source} delivers depth of shape {raw.shape} and type {raw.dtype} from "
                f"'{self._config.depth}', but one channel of uint16 is needed.",
                remedy="Use a format that OpenCV does not convert: Y16 for a device, GRAY16_LE for "
                "a pipeline, FFV1 gray16le for a video, or numbered 16-bit PNG files.",
            )
        return raw

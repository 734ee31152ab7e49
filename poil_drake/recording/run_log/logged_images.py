"""The images of a run's log, decoded when they are asked for."""

from collections import OrderedDict
from pathlib import Path

import numpy as np
from google.protobuf.message import DecodeError

from poil_drake.errors import DemonstrationError, InvalidValueError, RunLogError
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.recording.demonstration.layout import camera_topic
from poil_drake.recording.mcap.image_messages import decode_color, decode_depth, decode_label
from poil_drake.recording.mcap.scan import read_messages
from poil_drake.recording.mcap.timestamps import to_seconds
from poil_drake.recording.run_log.recorded_run import LoggedImages

_KEPT = 2
"""Tracker and detector look at the same image, and then at the next."""


class ImageReader:
    """Decodes the logged images of one camera; the last few are kept.

    Args:
        path: The log.
        camera: The camera's model, whose size the images must have.
        images: Its images; those without depth cannot be read.
    """

    def __init__(self, path: Path, camera: CameraModel, images: list[LoggedImages]):
        self._path, self._camera, self._images = path, camera, tuple(images)
        self._kept: OrderedDict[int, RgbdImage] = OrderedDict()

    def __call__(self, index: int) -> RgbdImage:
        """Returns the image of that number.

        Raises:
            RunLogError: if it cannot be decoded, has another size, or the file has changed.
        """
        image = self._kept.pop(index, None) or self._decode(self._images[index])
        self._kept[index] = image
        if len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return image

    def _decode(self, logged: LoggedImages) -> RgbdImage:
        stored = {"image": logged.color, "depth": logged.depth, "label": logged.label}
        given = {kind: image for kind, image in stored.items() if image is not None}
        decoders = {"image": decode_color, "depth": decode_depth, "label": decode_label}
        pixels: dict[str, np.ndarray] = {}
        topic = ""
        try:
            data = read_messages(self._path, [image.location for image in given.values()])
            for (kind, image), content in zip(given.items(), data, strict=True):
                topic = camera_topic(self._camera.name, kind)
                pixels[kind] = decoders[kind](image.message_type.FromString(content))
                self._check_size(pixels[kind])
        except (DecodeError, InvalidValueError, DemonstrationError) as error:
            problem = getattr(error, "problem", f"a message is damaged: {error}.")
            where = f"{self._path}, topic {topic}: " if topic else f"{self._path}: "
            raise RunLogError(
                f"{where}{problem}", remedy="Copy the log again, and replay what it was run with."
            ) from error
        return RgbdImage(
            rgb=pixels["image"],
            depth=pixels["depth"],
            stamp=to_seconds(logged.color.stamp),
            label=pixels.get("label"),
        )

    def _check_size(self, pixels: np.ndarray) -> None:
        height, width = pixels.shape[:2]
        camera = self._camera
        if (width, height) != (camera.width, camera.height):
            raise InvalidValueError(
                f"an image has {width} x {height} pixels, but the scenario's camera "
                f"'{camera.name}' has {camera.width} x {camera.height}.",
                remedy="Give the camera the size that it had.",
            )

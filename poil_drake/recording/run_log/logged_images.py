"""The images of a run's log, decoded when they are needed."""

from functools import lru_cache
from pathlib import Path

from poil_drake.errors import DemonstrationError, RunLogError
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.recording.demonstration.stored_images import read_images
from poil_drake.recording.mcap.timestamps import to_seconds
from poil_drake.recording.run_log.recorded_run import LoggedImages

_CACHED = 2
"""Tracker and detector look at the same image, and then at the next."""


class ImageReader:
    """Decodes the logged images of one camera; the last few are cached.

    Args:
        path: The log.
        camera: The camera's model, whose size the images must have.
        images: Its images; those without depth cannot be read.
    """

    def __init__(self, path: Path, camera: CameraModel, images: list[LoggedImages]):
        self._path, self._camera, self._images = path, camera, tuple(images)
        self._cached = lru_cache(_CACHED)(self._decode)

    def __call__(self, index: int) -> RgbdImage:
        """Returns an image by its index.

        Raises:
            RunLogError: if it cannot be decoded, has another size, or the file has changed.
        """
        return self._cached(index)

    def _decode(self, index: int) -> RgbdImage:
        logged, camera = self._images[index], self._camera
        try:
            pixels = read_images(
                self._path,
                camera.name,
                {"image": logged.color, "depth": logged.depth, "label": logged.label},
                size=(camera.width, camera.height),
                size_source=f"the scenario's camera '{camera.name}' has",
            )
        except DemonstrationError as error:
            raise RunLogError(
                error.problem,
                remedy="Copy the log again, and replay it with the cameras of the run.",
            ) from error
        return RgbdImage(
            rgb=pixels["image"],
            depth=pixels["depth"],
            stamp=to_seconds(logged.color.stamp),
            label=pixels.get("label"),
        )

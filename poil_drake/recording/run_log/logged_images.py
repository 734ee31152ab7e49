"""The images of a run's log, decoded when they are needed."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

from poil_drake.errors import DemonstrationError, RunLogError
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.recording.demonstration.stored_images import StoredImages

_CACHED = 2
"""Tracker and detector look at the same image, and then at the next."""


def make_image_reader(
    path: Path, camera: CameraModel, images: Sequence[StoredImages]
) -> Callable[[int], RgbdImage]:
    """Returns a function that decodes an image of a camera by its index; it caches the last few.

    The function raises a RunLogError if the image cannot be decoded or has another size, or if the
    file has changed.

    Args:
        path: The log.
        camera: The camera's model, whose size the images must have.
        images: Its images; those without depth cannot be read.
    """

    @lru_cache(_CACHED)
    def read(index: int) -> RgbdImage:
        try:
            return images[index].read(
                path,
                camera.name,
                size=(camera.width, camera.height),
                size_source=f"the scenario's camera '{camera.name}' has",
            )
        except DemonstrationError as error:
            raise RunLogError(
                error.problem,
                remedy="Copy the log again, and replay it with the cameras of the run.",
            ) from error

    return read

"""What all faults have in common."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel, RgbdImage


@dataclass(frozen=True, kw_only=True)
class TimedFault:
    """A fault that lasts for some time.

    Attributes:
        start: When the fault begins [s].
        duration: How long it lasts [s].
    """

    start: float = 0.0
    duration: float = math.inf

    def __post_init__(self) -> None:
        self._require("duration", self.duration > 0.0, "a positive time")

    def is_active(self, time: float) -> bool:
        """Returns whether the fault acts at a time of capture [s]."""
        return self.start <= time < self.start + self.duration

    def _require(self, name: str, valid: bool, wanted: str) -> None:
        if not valid:
            raise InvalidValueError(
                f"{type(self).__name__}.{name} is {getattr(self, name)}.",
                remedy=f"Set it to {wanted}.",
            )


@dataclass(frozen=True, kw_only=True)
class CameraFault(TimedFault):
    """A fault of one camera, or of all.

    Attributes:
        camera: The camera's name; empty for all cameras.
    """

    camera: str = ""

    def affects(self, camera: str) -> bool:
        """Returns whether the fault is one of the named camera."""
        return self.camera in ("", camera)


@dataclass(frozen=True, eq=False)
class Capture:
    """One image of one camera, with what a fault needs to change it.

    Attributes:
        camera: The camera's model.
        image: The image.
        object_mask: (H, W) bool, where the image shows the object; None if unknown.
        rng: The source of the fault's random numbers at this capture.
    """

    camera: CameraModel
    image: RgbdImage
    object_mask: np.ndarray | None = None
    rng: np.random.Generator = field(default_factory=np.random.default_rng)

    def changed(self, **fields: Any) -> RgbdImage:
        """Returns the image with the given fields (`rgb`, `depth`, `label`) replaced."""
        image = self.image
        return RgbdImage(
            rgb=fields.get("rgb", image.rgb),
            depth=fields.get("depth", image.depth),
            stamp=image.stamp,
            label=fields.get("label", image.label),
        )

"""Cameras and RGB-D images."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class CameraModel(SharedOnCopy):
    """A pinhole camera at a known pose.

    Attributes:
        name: The camera's name in the scenario.
        width: Image width [px].
        height: Image height [px].
        K: (3, 3) intrinsic matrix [px]; pixel centres are at integer coordinates.
        X_WC: (4, 4) pose of the camera's OpenCV optical frame (+z into the image, +x right,
            +y down) in the world [m].
    """

    name: str
    width: int
    height: int
    K: np.ndarray
    X_WC: np.ndarray

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise InvalidValueError(
                f"CameraModel '{self.name}' is {self.width} x {self.height} pixels.",
                remedy="Set a width and a height of at least 1 pixel.",
            )
        freeze_fields(self, K=(3, 3), X_WC=(4, 4))
        R = self.X_WC[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise InvalidValueError(
                f"CameraModel.X_WC of '{self.name}' has an invalid rotation: {R.tolist()}.",
                remedy="Pass a rigid transform with an orthonormal, right-handed rotation.",
            )


@dataclass(frozen=True, eq=False)
class RgbdImage(SharedOnCopy):
    """The colour and the depth image of one camera at one instant.

    Attributes:
        rgb: (H, W, 3) uint8 colour.
        depth: (H, W) float32 depth along the optical axis [m]; 0 where invalid.
        stamp: Time of capture [s].
        label: (H, W) int16 render labels from a simulator, or None.
    """

    rgb: np.ndarray
    depth: np.ndarray
    stamp: float
    label: np.ndarray | None = None

    def __post_init__(self) -> None:
        freeze_fields(self, dtype=np.uint8, rgb=("H", "W", 3))
        size = self.rgb.shape[:2]
        freeze_fields(self, dtype=np.float32, depth=size)
        if self.label is not None:
            freeze_fields(self, dtype=np.int16, label=size)


@dataclass(frozen=True, eq=False)
class MultiViewFrame(SharedOnCopy):
    """The images of all cameras at one instant.

    Attributes:
        cameras: The models of the V cameras.
        images: Their images, in the same order.
        label_ids: Maps each name to its render labels: "<object>" is a whole object,
            "<object>/<part>" is a part. An object's labels include those of its parts. The map is
            empty if the images have no labels.
    """

    cameras: tuple[CameraModel, ...]
    images: tuple[RgbdImage, ...]
    label_ids: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.cameras or len(self.cameras) != len(self.images):
            raise InvalidValueError(
                f"MultiViewFrame has {len(self.cameras)} cameras and {len(self.images)} images.",
                remedy="Pass one image for each camera, and at least one camera.",
            )
        for camera, image in zip(self.cameras, self.images, strict=True):
            if image.depth.shape != (camera.height, camera.width):
                raise InvalidValueError(
                    f"The image of camera '{camera.name}' has shape {image.depth.shape}, but the "
                    f"camera's model has ({camera.height}, {camera.width}).",
                    remedy="Use the calibration for this image size.",
                )
        object.__setattr__(self, "cameras", tuple(self.cameras))
        object.__setattr__(self, "images", tuple(self.images))
        label_ids = {name: tuple(int(i) for i in ids) for name, ids in self.label_ids.items()}
        object.__setattr__(self, "label_ids", MappingProxyType(label_ids))

    def __reduce__(self) -> tuple:
        """Supports pickling: the read-only view `label_ids` is pickled as a dict."""
        return type(self), (self.cameras, self.images, dict(self.label_ids))

    @property
    def stamp(self) -> float:
        """The capture time of the oldest image [s]."""
        return min(image.stamp for image in self.images)


def by_name(cameras: Sequence[str], images: Mapping[str, T]) -> tuple[T, ...]:
    """Returns the image of each camera, in the order of `cameras`.

    Images come from another process or file with the camera's name, because an order may not
    survive the way.

    Args:
        cameras: The cameras' names.
        images: Name -> image, or anything else that belongs to one camera.

    Raises:
        InvalidValueError: if a camera has no image, or an image belongs to no camera.
    """
    if images.keys() != set(cameras):
        raise InvalidValueError(
            f"There are images of {_listed(images)}, but the cameras are {_listed(cameras)}.",
            remedy="Use the same cameras on both sides.",
        )
    return tuple(images[name] for name in cameras)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names) or "no camera"

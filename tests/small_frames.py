"""Small frames to record: a smooth image of each of two cameras."""

from functools import cache
from typing import Any

import numpy as np

from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

WIDTH, HEIGHT = 32, 24
K = np.array([[30.0, 0.0, 15.5], [0.0, 31.0, 11.5], [0.0, 0.0, 1.0]])


@cache  # One object per camera, as in a recording.
def camera(name: str, height: float = 0.6) -> CameraModel:
    """Returns a camera that looks straight down."""
    X_WC = np.diag([1.0, -1.0, -1.0, 1.0])
    X_WC[:3, 3] = [0.4, 0.1 * len(name), height]
    return CameraModel(name, WIDTH, HEIGHT, K, X_WC)


def image(index: int, *, stamp: float, labelled: bool = False) -> RgbdImage:
    """Returns a smooth image that changes with the index, with a hole in its depth."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rgb = np.stack([60 + 3 * u, 80 + 4 * v, np.full_like(u, 20 + 10 * index)], axis=-1)
    depth = 0.5 + 0.0101 * v + 0.0037 * u + 0.001 * index
    depth[:3, :4] = 0.0
    label = (u + v + index).astype(np.int16) if labelled else None
    return RgbdImage(rgb.astype(np.uint8), depth.astype(np.float32), stamp, label)


def make_frame(
    index: int, names: tuple[str, ...] = ("left", "right"), **kwargs: Any
) -> MultiViewFrame:
    """Returns the frame of index i, at i / 8 s."""
    labelled = kwargs.get("labelled", False)
    return MultiViewFrame(
        tuple(camera(name, kwargs.get("height", 0.6)) for name in names),
        tuple(image(index, stamp=index / 8, labelled=labelled) for _ in names),
        {"mug": (3, 4), "mug/handle": (4,)} if labelled else {},
    )

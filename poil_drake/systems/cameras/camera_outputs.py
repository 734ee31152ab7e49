"""The output ports of systems that show camera images."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

from poil_drake.perception.images import RgbdImage


def DeclareCameraOutputs(
    system: LeafSystem,
    camera: str,
    *,
    image: Callable[[Context], RgbdImage | None],
    time: Callable[[Context], float],
    labels: bool | Callable[[Context], np.ndarray | None],
    prerequisites: set[Any],
) -> None:
    """Declares `<camera>.rgb_image`, `.depth_image`, `.label_image` and `.image_time`.

    An image port holds an empty image while there is nothing to show.

    Args:
        system: Receives the ports.
        camera: The camera's name.
        image: Returns the image to show, or None.
        time: Returns the value of `image_time` [s], NaN before the first image.
        labels: False: there is no label port. True: the port shows the labels of `image`. A
            function: it returns the label image (H, W) to show, or None.
        prerequisites: Tickets of everything that these functions depend on.
    """

    def declare(kind: str, empty: Any, pixels: Callable[[Context], np.ndarray | None]) -> None:
        def calc(context: Context, output: AbstractValue) -> None:
            _fill(output.get_mutable_value(), pixels(context))

        system.DeclareAbstractOutputPort(
            f"{camera}.{kind}", lambda: Value(empty()), calc, prerequisites
        )

    def field(name: str) -> Callable[[Context], np.ndarray | None]:
        return lambda context: getattr(image(context), name, None)

    declare("rgb_image", ImageRgba8U, field("rgb"))
    declare("depth_image", ImageDepth32F, field("depth"))
    if labels:
        declare("label_image", ImageLabel16I, labels if callable(labels) else field("label"))

    def calc_time(context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, time(context))

    system.DeclareVectorOutputPort(f"{camera}.image_time", 1, calc_time, prerequisites)


def _fill(output: Any, pixels: np.ndarray | None) -> None:
    """Copies RGB (H, W, 3), depth or labels (H, W) into Drake's image; None empties it."""
    height, width = (0, 0) if pixels is None else pixels.shape[:2]
    if (output.width(), output.height()) != (width, height):
        output.resize(width, height)
    if pixels is not None and pixels.ndim == 3:
        cv2.cvtColor(pixels, cv2.COLOR_RGB2RGBA, dst=output.mutable_data)
    elif pixels is not None:
        output.mutable_data[:, :, 0] = pixels

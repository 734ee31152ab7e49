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

    def declare(kind: str, empty: Any, fill: Callable[[Context, Any], bool]) -> None:
        def calc(context: Context, output: AbstractValue) -> None:
            if not fill(context, output.get_mutable_value()):
                output.get_mutable_value().resize(0, 0)

        system.DeclareAbstractOutputPort(
            f"{camera}.{kind}", lambda: Value(empty()), calc, prerequisites
        )

    def fill_rgb(context: Context, output: ImageRgba8U) -> bool:
        shown = image(context)
        if shown is not None:
            _resize(output, shown.rgb.shape)
            cv2.cvtColor(shown.rgb, cv2.COLOR_RGB2RGBA, dst=output.mutable_data)
        return shown is not None

    def fill_depth(context: Context, output: ImageDepth32F) -> bool:
        shown = image(context)
        return _fill_plane(output, None if shown is None else shown.depth)

    def fill_label(context: Context, output: ImageLabel16I) -> bool:
        if callable(labels):
            return _fill_plane(output, labels(context))
        shown = image(context)
        return _fill_plane(output, None if shown is None else shown.label)

    declare("rgb_image", ImageRgba8U, fill_rgb)
    declare("depth_image", ImageDepth32F, fill_depth)
    if labels:
        declare("label_image", ImageLabel16I, fill_label)

    def calc_time(context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, time(context))

    system.DeclareVectorOutputPort(f"{camera}.image_time", 1, calc_time, prerequisites)


def _fill_plane(output: Any, pixels: np.ndarray | None) -> bool:
    if pixels is not None:
        _resize(output, pixels.shape)
        output.mutable_data[:, :, 0] = pixels
    return pixels is not None


def _resize(image: Any, shape: tuple[int, ...]) -> None:
    height, width = shape[:2]
    if (image.width(), image.height()) != (width, height):
        image.resize(width, height)

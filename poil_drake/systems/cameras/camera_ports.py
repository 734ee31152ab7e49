"""The image ports of systems that use cameras, and of those that show their images."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

from poil_drake.errors import StationError
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.systems.absent import ABSENT


class CameraPorts:
    """Declares image ports on a system and reads frames from them.

    For each camera the system gets the ports `<name>.rgb_image` (ImageRgba8U) and
    `<name>.depth_image` (ImageDepth32F, [m] along the optical axis), and the optional port
    `<name>.image_time` (1,) [s]. Instead of the two images, the port `<name>.rgbd_image` may be
    connected, which holds an `RgbdImage`, or any other value while there is none. This spares the
    conversion of each image to Drake's types and back. If `image_time` is not connected, images are
    stamped with the time of evaluation. `label_ids` adds the optional port `<name>.label_image`
    (ImageLabel16I).

    Evaluate the image ports only in events. In simulation, an evaluation may render an image, which
    is slow.
    """

    def __init__(
        self,
        *,
        system: LeafSystem,
        cameras: Sequence[CameraModel],
        label_ids: Mapping[str, Sequence[int]] | None = None,
    ):
        """Declares the ports.

        Args:
            system: Receives the ports.
            cameras: The cameras' models, whose names are the prefixes of the ports' names.
            label_ids: The meaning of the labels (see `MultiViewFrame`); None: no label ports.
        """
        self._system = system
        self._cameras = tuple(cameras)
        self._label_ids = {name: tuple(ids) for name, ids in (label_ids or {}).items()}
        empty = {"rgb": ImageRgba8U(), "depth": ImageDepth32F(), "rgbd": ABSENT}
        if label_ids is not None:
            empty["label"] = ImageLabel16I()
        self._ports: dict[str, InputPort] = {}
        for camera in self._cameras:
            for kind, image in empty.items():
                name = f"{camera.name}.{kind}_image"
                self._ports[name] = system.DeclareAbstractInputPort(name, Value(image))
            name = f"{camera.name}.image_time"
            self._ports[name] = system.DeclareVectorInputPort(name, 1)

    def stamp(self, context: Context) -> float:
        """Returns the capture time [s] of the oldest image at the ports, without evaluating images.

        Returns NaN while a camera has no image. An image counts as captured now if its `image_time`
        is not connected.
        """
        return float(np.min([self._time(context, camera.name) for camera in self._cameras]))

    def labels_empty(self, context: Context) -> bool:
        """Returns whether any connected label image is empty.

        A source that labels only some of its images sends empty label images with the others.
        """
        labels = [self._value(context, f"{camera.name}.label_image") for camera in self._cameras]
        return any(label is not None and label.size() == 0 for label in labels)

    def capture(self, context: Context) -> MultiViewFrame | None:
        """Returns the cameras' current images, or None until every camera has one.

        Drake's images are copied, and their invalid depth becomes 0.

        Raises:
            StationError: if an image port is not connected.
        """
        found = [self._image(context, camera.name) for camera in self._cameras]
        images = tuple(image for image in found if image is not None)
        if len(images) < len(found):
            return None
        labelled = any(image.label is not None for image in images)
        return MultiViewFrame(
            cameras=self._cameras,
            images=images,
            label_ids=self._label_ids if labelled else {},
        )

    def _image(self, context: Context, camera: str) -> RgbdImage | None:
        stamp, labels = self._time(context, camera), self._value(context, f"{camera}.label_image")
        # Some images have no labels.
        label = labels.data[:, :, 0] if labels is not None and labels.size() else None
        whole = self._value(context, f"{camera}.rgbd_image")
        if isinstance(whole, RgbdImage):
            return RgbdImage(whole.rgb, whole.depth, stamp, label)
        if whole is not None:
            return None
        rgba = self._value(context, f"{camera}.rgb_image")
        depth = self._value(context, f"{camera}.depth_image")
        if rgba is None or depth is None:
            raise StationError(
                f"The images of camera '{camera}' are not connected to "
                f"'{self._system.get_name()}'.",
                remedy=f"Connect the station's ports {camera}.rgb_image and {camera}.depth_image.",
            )
        if rgba.size() == 0 or depth.size() == 0:
            return None
        return copied_image(rgba.data, depth.data, label, stamp=stamp)

    def _time(self, context: Context, camera: str) -> float:
        time = self._value(context, f"{camera}.image_time")
        return context.get_time() if time is None else float(time[0])

    def _value(self, context: Context, name: str) -> Any:
        """Returns the value of a port; None if it is not connected or does not exist."""
        port = self._ports.get(name)
        return port.Eval(context) if port is not None and port.HasValue(context) else None


def copied_image(
    rgba: np.ndarray, depth: np.ndarray, label: np.ndarray | None, *, stamp: float
) -> RgbdImage:
    """Returns an image, captured at `stamp` [s], that copies Drake's arrays (H, W, channels).

    The labels are (H, W). Depth that is not finite or not positive becomes 0.
    """
    rgb, metres = cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), depth[:, :, 0].copy()
    metres[~((metres > 0.0) & (metres < np.inf))] = 0.0
    rgb.flags.writeable = metres.flags.writeable = False  # Spares `RgbdImage` another copy.
    return RgbdImage(
        rgb=rgb,
        depth=metres,
        stamp=stamp,
        label=label,
    )


def DeclareCameraOutputs(
    system: LeafSystem,
    camera: str,
    *,
    image: Callable[[Context], RgbdImage | None],
    time: Callable[[Context], float],
    labels: bool | Callable[[Context], np.ndarray | None],
    prerequisites: set[Any],
) -> None:
    """Declares `<camera>.rgb_image`, `.depth_image`, `.rgbd_image`, `.label_image`, `.image_time`.

    While there is nothing to show, `rgbd_image` is `ABSENT`, and the other images are empty.

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

    def calc_whole(context: Context, output: AbstractValue) -> None:
        output.set_value(image(context) or ABSENT)

    system.DeclareAbstractOutputPort(
        f"{camera}.rgbd_image", lambda: Value(ABSENT), calc_whole, prerequisites
    )

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

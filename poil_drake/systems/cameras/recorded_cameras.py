"""Cameras that show what they showed when a run was recorded."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

from poil_drake.perception.images import RgbdImage
from poil_drake.recording.run_log.series import Series
from poil_drake.systems.cameras.drake_images import plane_image, rgba_image

_ROUNDING = 1e-6


@dataclass(frozen=True, kw_only=True)
class RecordedCamera:
    """What is known of one camera.

    Attributes:
        name: Its name.
        shown_from: When each of its images appeared [s], ascending.
        stamps: When each was captured [s].
        read: Returns the image of a number.
        labels: Whether some of its images have labels.
        times: (T, 1) when the newest image was captured [s], also of those that are not here;
            None: images are of the moment, as of a simulated camera without a delay.
    """

    name: str
    shown_from: Sequence[float]
    stamps: Sequence[float]
    read: Callable[[int], RgbdImage]
    labels: bool
    times: Series | None


class RecordedCameras(LeafSystem):
    """Shows the newest recorded image of each camera.

    .. pydrake_system::

        name: RecordedCameras
        output_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.label_image
        - <camera>.image_time

    The outputs are those of `CapturedCameras`, as functions of the time; before the first image,
    images are empty and times NaN. An image is decoded when somebody looks. Of the images between
    two that were recorded there is only `image_time` (1,) [s].
    """

    def __init__(self, *, cameras: Sequence[RecordedCamera]):
        """Constructs the system.

        Args:
            cameras: The cameras.
        """
        super().__init__()
        for camera in cameras:
            self._declare_outputs(camera)

    def _declare_outputs(self, camera: RecordedCamera) -> None:
        kinds: list[tuple[str, Any, Callable[[RgbdImage], Any]]] = [
            ("rgb_image", ImageRgba8U, lambda image: rgba_image(image.rgb)),
            ("depth_image", ImageDepth32F, lambda image: plane_image(ImageDepth32F, image.depth)),
        ]
        if camera.labels:
            kinds.append(("label_image", ImageLabel16I, _label))
        now = {self.time_ticket()}
        for kind, empty, convert in kinds:

            def allocate(empty: Any = empty) -> AbstractValue:
                return Value(empty())

            def calc(
                context: Context, output: AbstractValue, empty: Any = empty, convert: Any = convert
            ) -> None:
                index = _shown(camera, context.get_time())
                output.set_value(empty() if index < 0 else convert(camera.read(index)))

            self.DeclareAbstractOutputPort(f"{camera.name}.{kind}", allocate, calc, now)

        def calc_time(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, _image_time(camera, context.get_time()))

        self.DeclareVectorOutputPort(f"{camera.name}.image_time", 1, calc_time, now)


def _shown(camera: RecordedCamera, time: float) -> int:
    """Returns the number of the image that is shown at a time [s]; -1 before the first."""
    return bisect_right(camera.shown_from, time + _ROUNDING) - 1


def _image_time(camera: RecordedCamera, time: float) -> float:
    """Returns when the newest image was captured, as was known at a time [s]."""
    if camera.times is None:
        return time
    index = _shown(camera, time)
    stamp = camera.stamps[index] if index >= 0 else np.nan
    # An image that was recorded was the newest when somebody looked at it.
    return float(np.fmax(stamp, camera.times.at(time)[0]))


def _label(image: RgbdImage) -> ImageLabel16I:
    return ImageLabel16I() if image.label is None else plane_image(ImageLabel16I, image.label)

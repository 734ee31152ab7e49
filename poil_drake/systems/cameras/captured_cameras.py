"""Shows the newest images that capture threads have read from real cameras."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.cameras.camera_ports import DeclareCameraOutputs


class NewestImage(Protocol):
    """A source of images, such as a `CaptureThread`."""

    @property
    def newest(self) -> RgbdImage | None:
        """The newest image, with a stamp in [s since the epoch]; None before the first image."""


@dataclass(frozen=True, eq=False)
class _Shown(SharedOnCopy):
    """An image and its capture time in the context's time [s]; None and NaN before the first."""

    image: RgbdImage | None = None
    time: float = np.nan


class CapturedCameras(LeafSystem):
    """Shows the newest image of each real camera.

    .. pydrake_system::

        name: CapturedCameras
        output_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.rgbd_image
        - <camera>.label_image
        - <camera>.image_time

    Each period, an unrestricted update takes the newest images of the capture threads, without
    waiting. The drivers of RealSense, ZED, OpenCV and file cameras are in `perception/capture`.

    `rgb_image` is an ImageRgba8U, `depth_image` an ImageDepth32F ([m], 0 where invalid), and
    `rgbd_image` is the source's `RgbdImage` with both. `image_time` (1,) [s] is the capture time:
    the context's time minus the image's age, rounded to nanoseconds as in logs. `label_image`
    (ImageLabel16I) exists if the camera's source sends labels, and is empty if the newest image has
    none. Before the first image, images are empty, `rgbd_image` is `ABSENT`, and times are NaN;
    images captured before time 0 are ignored. If a camera freezes or disappears, its last image and
    time stay. Outputs depend on the state alone.
    """

    def __init__(
        self,
        *,
        cameras: Sequence[CameraModel],
        sources: Sequence[NewestImage],
        labels: Sequence[bool],
        period: float,
        clock: Callable[[], float] = time.time,
    ):
        """Constructs the system.

        Args:
            cameras: The cameras' models.
            sources: The source of each camera's images.
            labels: Whether each source sends label images.
            period: Time between two updates [s].
            clock: The clock that stamps the images: returns the current time [s since the epoch].
        """
        super().__init__()
        self._sources, self._clock = tuple(sources), clock
        nothing = (_Shown(),) * len(self._sources)
        self._newest = self.DeclareAbstractState(Value[object](nothing))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        for view, (camera, labelled) in enumerate(zip(cameras, labels, strict=True)):
            self._declare_outputs(view, camera.name, labelled)

    def _update(self, context: Context, state: State) -> None:
        before: tuple[_Shown, ...] = context.get_abstract_state(self._newest).get_value()
        newest = [source.newest for source in self._sources]
        if all(image is shown.image for image, shown in zip(newest, before, strict=True)):
            return
        start = context.get_time() - self._clock()
        after = tuple(
            shown
            if image is None or image is shown.image or start + image.stamp < 0.0
            else _Shown(image, round(start + image.stamp, 9))
            for image, shown in zip(newest, before, strict=True)
        )
        state.get_mutable_abstract_state(self._newest).set_value(after)

    def _declare_outputs(self, view: int, name: str, labelled: bool) -> None:
        DeclareCameraOutputs(
            self,
            name,
            image=lambda context: self._shown(context, view).image,
            time=lambda context: self._shown(context, view).time,
            labels=labelled,
            prerequisites={self.abstract_state_ticket(self._newest)},
        )

    def _shown(self, context: Context, view: int) -> _Shown:
        return context.get_abstract_state(self._newest).get_value()[view]

"""Real cameras as a system: what their capture threads have seen last."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.cameras.drake_images import fill_plane, fill_rgba


class NewestImage(Protocol):
    """Somebody who captures images, such as a `CaptureThread`."""

    @property
    def newest(self) -> RgbdImage | None:
        """The newest image; its stamp is by the clock [s since the epoch]. None before it."""


@dataclass(frozen=True, eq=False)
class _Seen(SharedOnCopy):
    """An image, None before the first, and its time [s, of the context]."""

    image: RgbdImage | None = None
    time: float = np.nan


class CapturedCameras(LeafSystem):
    """Shows the newest image of each real camera.

    .. pydrake_system::

        name: CapturedCameras
        output_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.label_image
        - <camera>.image_time

    Each period it looks at what the capture threads have, in an unrestricted update; it never waits
    for them. `rgb_image` (ImageRgba8U), `depth_image` (ImageDepth32F [m], 0 where invalid),
    `image_time` (1,) [s], when the image was captured, in the time of the context: now, less the
    image's age by the clock, in whole nanoseconds as logs have them. `label_image` (ImageLabel16I)
    is there where somebody sends label images along with the others, and empty where the newest
    image has none. Before the first image images are empty and times NaN; an image from before the
    time 0 is none. A camera that is frozen or gone keeps its last image and its time, which ages.
    Every output is a function of the state.
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
            sources: Who captures the images of each.
            labels: Whether it gives label images, too, for each.
            period: Between two looks [s].
            clock: The time now [s since the epoch], as in the images' stamps.
        """
        super().__init__()
        self._sources, self._clock = tuple(sources), clock
        nothing = (_Seen(),) * len(self._sources)
        self._seen = self.DeclareAbstractState(Value[object](nothing))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        for view, (camera, labelled) in enumerate(zip(cameras, labels, strict=True)):
            self._declare_outputs(view, camera.name, labelled)

    def _look(self, context: Context, state: State) -> None:
        before: tuple[_Seen, ...] = context.get_abstract_state(self._seen).get_value()
        newest = [source.newest for source in self._sources]
        if all(image is seen.image for image, seen in zip(newest, before, strict=True)):
            return
        start = context.get_time() - self._clock()
        after = tuple(
            seen
            if image is None or image is seen.image or start + image.stamp < 0.0
            else _Seen(image, round(start + image.stamp, 9))
            for image, seen in zip(newest, before, strict=True)
        )
        state.get_mutable_abstract_state(self._seen).set_value(after)

    def _declare_outputs(self, view: int, name: str, labelled: bool) -> None:
        known = {self.abstract_state_ticket(self._seen)}
        kinds: list[tuple[str, Any, Callable[[Any, RgbdImage], None]]] = [
            ("rgb_image", ImageRgba8U, lambda output, image: fill_rgba(output, image.rgb)),
            ("depth_image", ImageDepth32F, lambda output, image: fill_plane(output, image.depth)),
        ]
        if labelled:
            kinds.append(("label_image", ImageLabel16I, _fill_label))
        for kind, empty, fill in kinds:

            def allocate(empty: Any = empty) -> AbstractValue:
                return Value(empty())

            def calc(context: Context, output: AbstractValue, fill: Any = fill) -> None:
                image = self._shown(context, view).image
                if image is None:
                    output.get_mutable_value().resize(0, 0)
                else:
                    fill(output.get_mutable_value(), image)

            self.DeclareAbstractOutputPort(f"{name}.{kind}", allocate, calc, known)

        def calc_time(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, self._shown(context, view).time)

        self.DeclareVectorOutputPort(f"{name}.image_time", 1, calc_time, known)

    def _shown(self, context: Context, view: int) -> _Seen:
        return context.get_abstract_state(self._seen).get_value()[view]


def _fill_label(output: ImageLabel16I, image: RgbdImage) -> None:
    if image.label is None:
        output.resize(0, 0)
    else:
        fill_plane(output, image.label)

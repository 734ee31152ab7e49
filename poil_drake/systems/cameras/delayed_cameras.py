"""Cameras whose images appear a while after their capture, and are rendered meanwhile."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.all_finite import all_finite
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.runtime.background_thread import Background
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.cameras.drake_images import plane_image, rgba_image
from poil_drake.systems.tracking.release_schedule import Captured, ReleaseSchedule


class SceneRenderer(Protocol):
    """Renders a scene; its calls may take long, and come from one thread at a time."""

    def render(self, positions: np.ndarray, time: float) -> tuple[RgbdImage, ...]:
        """Returns what the cameras see, with the stamp `time` [s].

        Args:
            positions: The plant's generalised positions (nq,).
            time: The time [s], which seeds the noise.
        """
        ...

    def render_labels(self, positions: np.ndarray, time: float) -> tuple[np.ndarray, ...]:
        """Returns the render labels (H, W) int16 of what `render` shows."""
        ...


@dataclass(frozen=True, eq=False)
class _Capture(SharedOnCopy):
    """What was captured.

    Attributes:
        time: When [s].
        images: The images, once they are ready.
        labels: Returns the label images; they are rendered with the first call.
    """

    time: float
    images: Future[tuple[RgbdImage, ...]]
    labels: Callable[[], tuple[np.ndarray, ...]]


class DelayedCameras(LeafSystem):
    """Captures the scene at a fixed rate, and shows each image a fixed delay later.

    .. pydrake_system::

        name: DelayedCameras
        input_ports:
        - plant_state
        output_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.label_image
        - <camera>.image_time

    The delay is that of a real camera, from exposure to delivery; the simulation goes on meanwhile,
    while the images are rendered elsewhere, and is held up when they are due before they are ready.
    So what comes out, and when, does not depend on how fast anything is. Drake's `RgbdSensorAsync`
    does the same with a thread. Every capture is rendered, whether somebody looks or not.

    Input: `plant_state` (nq + nv,), of which the positions are taken. Where they are not finite,
    nothing is captured, and the last images stay.

    Outputs, for each camera: `rgb_image` (ImageRgba8U), `depth_image` (ImageDepth32F [m], 0 where
    invalid), `label_image` (ImageLabel16I, rendered when somebody looks, which is slow) and
    `image_time` (1,), the time of the capture [s]. Until the first image is due, images are empty
    and times NaN. Every output is a function of the state.

    Captures are unrestricted updates at multiples of the period, and see the state of the plant at
    that time; images change in unrestricted updates a delay later.
    """

    def __init__(
        self,
        *,
        renderer: SceneRenderer,
        cameras: Sequence[CameraModel],
        num_positions: int,
        num_velocities: int,
        period: float,
        delay: float,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the system.

        Args:
            renderer: What renders.
            cameras: The cameras' models, in the order in which it gives their images.
            num_positions: Size of the plant's positions, nq.
            num_velocities: Size of the plant's velocities, nv.
            period: From one capture to the next [s].
            delay: From a capture to its images [s].
            stopwatch: Where to note how long images take ("rendering", beside the simulation) and
                waiting for them ("waiting").

        Raises:
            InvalidValueError: if there is no delay.
        """
        super().__init__()
        if not (delay > 0.0 and not ReleaseSchedule(period=period, latency=delay).immediate):
            raise InvalidValueError(
                f"DelayedCameras.delay is {delay} s.",
                remedy="It must be positive; use RgbdSensor for cameras without a delay.",
            )
        self._renderer, self._stopwatch = renderer, stopwatch or Stopwatch()
        self._cameras, self._num_positions = tuple(cameras), num_positions
        self._schedule = ReleaseSchedule(period=period, latency=delay)
        self._background = Background("cameras' thread")
        self._plant_state = self.DeclareVectorInputPort(
            "plant_state", num_positions + num_velocities
        )
        self._queue = self.DeclareAbstractState(Value(()))
        self._shown = self.DeclareAbstractState(Value(ABSENT))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._capture)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, delay, self._release)
        for view, camera in enumerate(self._cameras):
            self._declare_outputs(view, camera.name)

    @property
    def cameras(self) -> tuple[CameraModel, ...]:
        """The cameras' models."""
        return self._cameras

    def close(self) -> None:
        """Ends the thread that waits for images. No capture may follow."""
        self._background.close()

    def _declare_outputs(self, view: int, name: str) -> None:
        known = {self.abstract_state_ticket(self._shown)}

        def rgb(capture: _Capture) -> ImageRgba8U:
            return rgba_image(capture.images.result()[view].rgb)

        def depth(capture: _Capture) -> ImageDepth32F:
            return plane_image(ImageDepth32F, capture.images.result()[view].depth)

        def label(capture: _Capture) -> ImageLabel16I:
            return plane_image(ImageLabel16I, capture.labels()[view])

        def calc_time(context: Context, output: BasicVector) -> None:
            capture = self._shown_capture(context)
            output.SetAtIndex(0, np.nan if capture is None else capture.time)

        for kind, empty, convert in (
            ("rgb_image", ImageRgba8U, rgb),
            ("depth_image", ImageDepth32F, depth),
            ("label_image", ImageLabel16I, label),
        ):

            def allocate(empty: Any = empty) -> AbstractValue:
                return Value(empty())

            def calc(
                context: Context, output: AbstractValue, empty: Any = empty, convert: Any = convert
            ) -> None:
                capture = self._shown_capture(context)
                output.set_value(empty() if capture is None else convert(capture))

            self.DeclareAbstractOutputPort(f"{name}.{kind}", allocate, calc, known)
        self.DeclareVectorOutputPort(f"{name}.image_time", 1, calc_time, known)

    def _shown_capture(self, context: Context) -> _Capture | None:
        """Returns what is shown; its images are ready."""
        shown = context.get_abstract_state(self._shown).get_value()
        return shown if isinstance(shown, _Capture) else None

    def _capture(self, context: Context, state: State) -> None:
        positions = self._plant_state.Eval(context)[: self._num_positions].copy()
        if not all_finite(positions):
            return
        time, renderer = context.get_time(), self._renderer

        def render() -> tuple[RgbdImage, ...]:
            with self._stopwatch.measure("rendering"):
                return renderer.render(positions, time)

        def render_labels() -> tuple[np.ndarray, ...]:
            return self._background.submit(renderer.render_labels, positions, time).result()

        capture = _Capture(time, self._background.submit(render), cache(render_labels))
        queue: tuple[Captured, ...] = context.get_abstract_state(self._queue).get_value()
        queue = self._schedule.added(queue, time, capture)
        state.get_mutable_abstract_state(self._queue).set_value(queue)

    def _release(self, context: Context, state: State) -> None:
        queue = context.get_abstract_state(self._queue).get_value()
        due = self._schedule.due(queue, context.get_time())
        if due is None:
            return
        with self._stopwatch.measure("waiting"):
            due.item.images.result()
        state.get_mutable_abstract_state(self._shown).set_value(due.item)

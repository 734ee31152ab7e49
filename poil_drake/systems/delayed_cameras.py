"""Cameras whose images appear a while after their capture, and are rendered meanwhile."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.all_finite import all_finite
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.release_schedule import Captured, ReleaseSchedule
from poil_drake.systems.stopwatch import Stopwatch


class Photographer(Protocol):
    """Takes pictures of a scene; its calls may take long, and come from one thread at a time."""

    def take(self, positions: np.ndarray, time: float) -> tuple[RgbdImage, ...]:
        """Returns what the cameras show, with the stamp `time` [s].

        Args:
            positions: The plant's generalised positions (nq,).
            time: The time [s], which seeds the noise.
        """
        ...

    def take_labels(self, positions: np.ndarray, time: float) -> tuple[np.ndarray, ...]:
        """Returns the render labels (H, W) int16 of what `take` shows."""
        ...


@dataclass(frozen=True, eq=False)
class _Exposure(SharedOnCopy):
    """What was captured: the scene then, and its images, once they are ready."""

    positions: np.ndarray
    time: float
    images: Future[tuple[RgbdImage, ...]]


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
    does the same with a thread.

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
        photographer: Photographer,
        cameras: Sequence[CameraModel],
        num_positions: int,
        num_velocities: int,
        period: float,
        delay: float,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the system.

        Args:
            photographer: What renders.
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
        if not delay > 0.0:
            raise InvalidValueError(
                f"DelayedCameras.delay is {delay} s.",
                remedy="It must be positive; use RgbdSensor for cameras without a delay.",
            )
        self._photographer, self._stopwatch = photographer, stopwatch or Stopwatch()
        self._cameras, self._num_positions = tuple(cameras), num_positions
        self._schedule = ReleaseSchedule(period=period, latency=delay)
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="cameras")
        self._plant_state = self.DeclareVectorInputPort(
            "plant_state", num_positions + num_velocities
        )
        self._queue = self.DeclareAbstractState(Value(()))
        self._shown = self.DeclareAbstractState(Value(object()))
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
        self._worker.shutdown(wait=True, cancel_futures=True)

    def _declare_outputs(self, view: int, name: str) -> None:
        known = {self.abstract_state_ticket(self._shown)}

        def calc_rgb(context: Context, output: AbstractValue) -> None:
            if (exposure := self._exposure(context)) is not None:
                rgb = exposure.images.result()[view].rgb
                image = ImageRgba8U(rgb.shape[1], rgb.shape[0])
                cv2.cvtColor(rgb, cv2.COLOR_RGB2RGBA, dst=image.mutable_data)
                output.set_value(image)

        def calc_depth(context: Context, output: AbstractValue) -> None:
            if (exposure := self._exposure(context)) is not None:
                depth = exposure.images.result()[view].depth
                image = ImageDepth32F(depth.shape[1], depth.shape[0])
                image.mutable_data[:, :, 0] = depth
                output.set_value(image)

        def calc_label(context: Context, output: AbstractValue) -> None:
            if (exposure := self._exposure(context)) is not None:
                label = self._labels(exposure)[view]
                image = ImageLabel16I(label.shape[1], label.shape[0])
                image.mutable_data[:, :, 0] = label
                output.set_value(image)

        def calc_time(context: Context, output: BasicVector) -> None:
            exposure = self._exposure(context)
            output.SetAtIndex(0, np.nan if exposure is None else exposure.time)

        for kind, empty, calc in (
            ("rgb_image", ImageRgba8U, calc_rgb),
            ("depth_image", ImageDepth32F, calc_depth),
            ("label_image", ImageLabel16I, calc_label),
        ):

            def allocate(empty: Any = empty) -> AbstractValue:
                return Value(empty())

            self.DeclareAbstractOutputPort(f"{name}.{kind}", allocate, calc, known)
        self.DeclareVectorOutputPort(f"{name}.image_time", 1, calc_time, known)

    def _exposure(self, context: Context) -> _Exposure | None:
        """Returns what is shown; its images are ready."""
        shown = context.get_abstract_state(self._shown).get_value()
        return shown if isinstance(shown, _Exposure) else None

    def _labels(self, exposure: _Exposure) -> tuple[np.ndarray, ...]:
        take = self._photographer.take_labels
        return self._worker.submit(take, exposure.positions, exposure.time).result()

    def _capture(self, context: Context, state: State) -> None:
        positions = self._plant_state.Eval(context)[: self._num_positions].copy()
        if not all_finite(positions):
            return
        time = context.get_time()
        exposure = _Exposure(positions, time, self._worker.submit(self._take, positions, time))
        queue: tuple[Captured, ...] = context.get_abstract_state(self._queue).get_value()
        queue = self._schedule.added(queue, time, exposure)
        state.get_mutable_abstract_state(self._queue).set_value(queue)

    def _take(self, positions: np.ndarray, time: float) -> tuple[RgbdImage, ...]:
        with self._stopwatch.measure("rendering"):
            return self._photographer.take(positions, time)

    def _release(self, context: Context, state: State) -> None:
        queue = context.get_abstract_state(self._queue).get_value()
        due = self._schedule.due(queue, context.get_time())
        if due is None:
            return
        with self._stopwatch.measure("waiting"):
            due.item.images.result()
        state.get_mutable_abstract_state(self._shown).set_value(due.item)

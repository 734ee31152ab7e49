"""Simulated cameras whose images appear a fixed delay after their capture."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.perception.images import CameraModel, RgbdImage, by_name
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.cameras.camera_ports import DeclareCameraOutputs
from poil_drake.systems.capture_and_release import CaptureAndRelease
from poil_drake.systems.capture_timing import Captured, SimulatedDelay


class SceneRenderer(Protocol):
    """Renders a scene. Calls may take long; only one thread calls at a time."""

    def render(self, positions: np.ndarray, time: float) -> Mapping[str, RgbdImage]:
        """Returns the image of each camera by its name, with the stamp `time` [s].

        Args:
            positions: The plant's generalised positions (nq,).
            time: The time of the capture [s], which also seeds the noise.
        """
        ...

    def render_labels(self, positions: np.ndarray, time: float) -> Mapping[str, np.ndarray]:
        """Returns the label image (H, W) int16 of each camera by its name."""
        ...


class _Rendered(NamedTuple):
    """The images of a capture, and a function that renders the label images at its first call."""

    images: tuple[RgbdImage | None, ...]
    labels: Callable[[], tuple[np.ndarray | None, ...]]


class DelayedCameras(LeafSystem):
    """Captures the scene at a fixed rate, and shows each image a fixed delay later.

    .. pydrake_system::

        name: DelayedCameras
        input_ports:
        - plant_state
        output_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.rgbd_image
        - <camera>.label_image
        - <camera>.image_time

    The delay models the time from exposure to delivery in a real camera. Images are rendered in the
    background while the simulation continues. The simulation waits only for images that are due but
    not ready, so the outputs do not depend on the speed of the machine. The images of every capture
    are rendered, even if nothing uses them. Drake's `RgbdSensorAsync` is similar.

    Input: `plant_state` (nq + nv,), of which only the positions are used. If they are not finite,
    nothing is captured, and the last images stay.

    Outputs, for each camera: `rgb_image` (ImageRgba8U), `depth_image` (ImageDepth32F [m], 0 where
    invalid), both as one `RgbdImage` in `rgbd_image`, `label_image` (ImageLabel16I, rendered when
    evaluated, which is slow) and `image_time` (1,), the image's stamp [s]. Until the first
    image is due, images are empty, `rgbd_image` is `ABSENT`, and times are NaN. Every output is a
    function of the state.

    An unrestricted update at each multiple of the period captures the plant's state at that time.
    Another unrestricted update shows the images one delay later.

    Attributes:
        cameras: The cameras' models.
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
            renderer: Renders the images of exactly these cameras.
            cameras: The cameras' models.
            num_positions: Size of the plant's positions, nq.
            num_velocities: Size of the plant's velocities, nv.
            period: Time from one capture to the next [s].
            delay: Time from a capture until its images appear [s].
            stopwatch: Records the time to render images ("rendering", parallel to the simulation)
                and the time spent waiting for them ("waiting").
        """
        super().__init__()
        self._renderer, self._stopwatch = renderer, stopwatch or Stopwatch()
        self.cameras, self._num_positions = tuple(cameras), num_positions
        self._plant_state = self.DeclareVectorInputPort(
            "plant_state", num_positions + num_velocities
        )
        empty = (None,) * len(self.cameras)
        self._rendered = CaptureAndRelease(
            system=self,
            timing=SimulatedDelay(period=period, latency=delay),
            nothing=_Rendered(empty, lambda: empty),
            begin=self._begin,
            thread="cameras' thread",
            stopwatch=stopwatch,
        )
        for view, camera in enumerate(self.cameras):
            self._declare_outputs(view, camera.name)

    def close(self) -> None:
        """Ends the rendering thread. Later captures raise `StationError`."""
        self._rendered.close()

    def _declare_outputs(self, view: int, name: str) -> None:
        def time(context: Context) -> float:
            image = self._rendered.result(context).images[view]
            return np.nan if image is None else image.stamp

        DeclareCameraOutputs(
            self,
            name,
            image=lambda context: self._rendered.result(context).images[view],
            time=time,
            labels=lambda context: self._rendered.result(context).labels()[view],
            prerequisites=self._rendered.tickets,
        )

    def _begin(
        self, context: Context, state: State, previous: Captured | None
    ) -> Callable[[], _Rendered] | None:
        positions = self._plant_state.Eval(context)[: self._num_positions].copy()
        if not np.isfinite(positions).all():
            return None
        time, renderer = context.get_time(), self._renderer
        names = [camera.name for camera in self.cameras]

        @cache
        def labels() -> tuple[np.ndarray, ...]:
            work = self._rendered.submit(lambda: renderer.render_labels(positions, time))
            return by_name(names, work.result())

        def render() -> _Rendered:
            with self._stopwatch.measure("rendering"):
                return _Rendered(by_name(names, renderer.render(positions, time)), labels)

        return render

"""Renders a scene as faulty cameras deliver it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from poil_drake.perception.faults.injector import FaultInjector
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage, by_name
from poil_drake.systems.cameras.delayed_cameras import SceneRenderer


class FaultyRenderer:
    """A `SceneRenderer` that injects faults into the images of another one.

    Faults such as `FrozenFrames` repeat earlier images, so the scene must be rendered in the order
    of the times. Label images show the scene without faults.
    """

    def __init__(
        self,
        renderer: SceneRenderer,
        *,
        injector: FaultInjector,
        cameras: Sequence[CameraModel],
        label_ids: Mapping[str, tuple[int, ...]],
    ):
        """Constructs the renderer.

        Args:
            renderer: Renders the images of exactly these cameras.
            injector: Injects the faults; it must serve no other stream of images.
            cameras: The cameras' models.
            label_ids: Render labels by name, see `MultiViewFrame`.
        """
        self._renderer, self._injector = renderer, injector
        self._cameras, self._label_ids = tuple(cameras), label_ids

    def render(self, positions: np.ndarray, time: float) -> Mapping[str, RgbdImage]:
        """See `SceneRenderer.render`; an image that does not arrive keeps its earlier stamp."""
        names = [camera.name for camera in self._cameras]
        images = by_name(names, self._renderer.render(positions, time))
        if self._injector.needs_labels(time):
            labels = by_name(names, self._renderer.render_labels(positions, time))
            images = tuple(replace(i, label=n) for i, n in zip(images, labels, strict=True))
        frame = MultiViewFrame(self._cameras, images, self._label_ids)
        delivered = self._injector.apply(frame).images
        return {n: replace(i, label=None) for n, i in zip(names, delivered, strict=True)}

    def render_labels(self, positions: np.ndarray, time: float) -> Mapping[str, np.ndarray]:
        """See `SceneRenderer.render_labels`."""
        return self._renderer.render_labels(positions, time)

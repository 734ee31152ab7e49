"""Sends the images of a simulated robot's cameras over LCM."""

import time
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from poil_drake.runtime.background_thread import Background
from poil_drake.systems.cameras.delayed_cameras import SceneRenderer
from poil_drake.systems.cameras.lcm_image_messages import encode_images
from poil_drake.systems.lcm.network import Clock, LcmNetwork


class LcmCameraFeed(LeafSystem):
    """Renders a simulated scene at a fixed rate, and sends the images when they are ready.

    .. pydrake_system::

        name: LcmCameraFeed
        input_ports:
        - plant_state

    Each period, a publish event captures `plant_state` (nq + nv,), the plant's state; a thread then
    renders and sends the images, stamped with the clock's time at the capture. The simulation does
    not wait: like a camera that drops frames, the feed skips captures while it renders or sends.
    Label images take as long to render as colour and depth, so only every `label_every`-th capture
    includes them. `close` ends the thread.
    """

    def __init__(
        self,
        *,
        renderer: SceneRenderer,
        cameras: Sequence[str],
        channels: Sequence[str],
        url: str,
        num_positions: int,
        num_velocities: int,
        period: float,
        label_every: int = 8,
        clock: Clock = time.time,
    ):
        """Constructs the feed.

        Args:
            renderer: Renders the images.
            cameras: The cameras' names, in the order of the renderer's images.
            channels: The LCM channel of each camera's images.
            url: The URL of the LCM network.
            num_positions: Size of the plant's positions, nq.
            num_velocities: Size of the plant's velocities, nv.
            period: Time from one capture to the next [s].
            label_every: One capture in this many includes label images.
            clock: Returns the current time [s since the epoch].
        """
        super().__init__()
        self._renderer, self._clock = renderer, clock
        self._channels = dict(zip(cameras, channels, strict=True))
        self._num_positions, self._label_every = num_positions, label_every
        self._lcm = LcmNetwork(url)
        self._background = Background("camera feed's thread")
        self._work: Future[None] | None = None
        self._captures = 0
        self._state = self.DeclareVectorInputPort("plant_state", num_positions + num_velocities)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._capture)

    def close(self) -> None:
        """Sends the images in progress, then ends the thread."""
        self._background.close()

    def _capture(self, context: Context) -> None:
        if self._work is not None:
            if not self._work.done():
                return
            self._work.result()  # Raises the thread's error, if any.
        positions = self._state.Eval(context)[: self._num_positions].copy()
        labels = self._captures % self._label_every == 0
        self._captures += 1
        self._work = self._background.submit(
            self._send, positions, context.get_time(), self._clock(), labels
        )

    def _send(self, positions: np.ndarray, now: float, stamp: float, labels: bool) -> None:
        images = self._renderer.render(positions, now)
        found: Sequence[np.ndarray | None] = [None] * len(images)
        if labels:
            found = self._renderer.render_labels(positions, now)
        for (name, channel), image, label in zip(
            self._channels.items(), images, found, strict=True
        ):
            stamped = replace(image, stamp=stamp, label=label)
            self._lcm.Publish(channel, encode_images(stamped, camera=name))

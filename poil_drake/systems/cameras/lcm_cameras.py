"""Cameras over LCM: sends the images of simulated ones, and receives those of any."""

import time
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from poil_drake.errors import CaptureError
from poil_drake.perception.images import RgbdImage
from poil_drake.runtime.background_thread import Background
from poil_drake.systems.cameras.delayed_cameras import SceneRenderer
from poil_drake.systems.cameras.lcm_image_messages import decode_images, encode_images
from poil_drake.systems.lcm.network import Clock, LcmNetwork

_LABEL_EVERY = 8
"""One capture in this many includes label images."""

_WAITING = 4
"""Capacity of the queue of unread images, which usually holds at most one."""

_BACKLOG = 64
"""Capacity of the queue if every image is wanted: two seconds at 30 images per second."""

_PATIENCE = 100
"""How long `read` waits for an image [ms]; other threads run meanwhile."""


class LcmCameraFeed(LeafSystem):
    """Renders a simulated scene at a fixed rate, and sends the images when they are ready.

    .. pydrake_system::

        name: LcmCameraFeed
        input_ports:
        - plant_state

    Each period, a publish event captures `plant_state` (nq + nv,), the plant's state; a thread then
    renders and sends the images, stamped with the clock's time at the capture. The simulation does
    not wait: like a camera that drops frames, the feed skips captures while it renders or sends.
    Label images take as long to render as colour and depth, so only every eighth capture includes
    them. `close` ends the thread.
    """

    def __init__(
        self,
        *,
        renderer: SceneRenderer,
        channels: Mapping[str, str],
        url: str,
        num_positions: int,
        num_velocities: int,
        period: float,
        clock: Clock = time.time,
    ):
        """Constructs the feed.

        Args:
            renderer: Renders the images.
            channels: Camera -> LCM channel of its images, in the order of the renderer's images.
            url: The URL of the LCM network.
            num_positions: Size of the plant's positions, nq.
            num_velocities: Size of the plant's velocities, nv.
            period: Time from one capture to the next [s].
            clock: Returns the current time [s since the epoch].
        """
        super().__init__()
        self._renderer, self._channels, self._clock = renderer, channels, clock
        self._num_positions = num_positions
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
        labels = self._captures % _LABEL_EVERY == 0
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


class LcmImageDevice:
    """A `CaptureDevice` that reads the newest image, or every image, from an LCM channel.

    It opens its own LCM network, so images are received and decoded on the thread that calls
    `read`, not on the thread that commands the robot. The sender sets the stamps.
    """

    def __init__(self, *, url: str, channel: str, size: tuple[int, int], every_image: bool = False):
        """Stores the settings; `open` opens the channel.

        Args:
            url: The URL of the LCM network.
            channel: The channel of the images.
            size: (height, width) of the images [px].
            every_image: Whether images that arrived meanwhile are read one after the other.
        """
        self._url, self._channel, self._size = url, channel, size
        self._lcm: LcmNetwork | None = None
        self._capacity = _BACKLOG if every_image else _WAITING
        self._unread = deque[bytes](maxlen=_BACKLOG if every_image else 1)

    def open(self) -> None:
        """See `CaptureDevice.open`."""
        self._unread.clear()
        self._lcm = LcmNetwork(self._url, queue_capacity=self._capacity)
        self._lcm.Subscribe(self._channel, self._unread.append)

    def read(self) -> RgbdImage | None:
        """See `CaptureDevice.read`."""
        if self._lcm is None:
            raise CaptureError(
                f"The channel {self._channel} is not open.", remedy="Call `open` before `read`."
            )
        self._lcm.HandleSubscriptions(0 if self._unread else _PATIENCE)
        if not self._unread:
            return None
        return decode_images(self._unread.popleft(), size=self._size)

    def close(self) -> None:
        """See `CaptureDevice.close`."""
        self._lcm = None

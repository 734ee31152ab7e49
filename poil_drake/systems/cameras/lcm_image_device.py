"""A camera whose images arrive over LCM from a process that reads or simulates it."""

from poil_drake.errors import CaptureError
from poil_drake.perception.images import RgbdImage
from poil_drake.systems.cameras.lcm_image_messages import decode_images
from poil_drake.systems.lcm.network import LcmNetwork

_WAITING = 4
"""Capacity of the queue of unread images, which usually holds at most one."""

_PATIENCE = 100
"""How long `read` waits for an image [ms]; other threads run meanwhile."""


class LcmImageDevice:
    """A `CaptureDevice` that reads the newest image from an LCM channel.

    It opens its own LCM network, so images are received and decoded on the thread that calls
    `read`, not on the thread that commands the robot. The sender sets the stamps.
    """

    def __init__(self, *, url: str, channel: str, size: tuple[int, int]):
        """Stores the settings; `open` opens the channel.

        Args:
            url: The URL of the LCM network.
            channel: The channel of the images.
            size: (height, width) of the images [px].
        """
        self._url, self._channel, self._size = url, channel, size
        self._lcm: LcmNetwork | None = None
        self._newest: bytes | None = None

    def open(self) -> None:
        """See `CaptureDevice.open`."""
        self._newest = None
        self._lcm = LcmNetwork(self._url, queue_capacity=_WAITING)
        self._lcm.Subscribe(self._channel, self._receive)

    def read(self) -> RgbdImage | None:
        """See `CaptureDevice.read`."""
        if self._lcm is None:
            raise CaptureError(
                f"The channel {self._channel} is not open.", remedy="Call `open` before `read`."
            )
        self._lcm.HandleSubscriptions(_PATIENCE)
        if self._newest is None:
            return None
        message, self._newest = self._newest, None
        return decode_images(message, size=self._size)

    def close(self) -> None:
        """See `CaptureDevice.close`."""
        self._lcm = None

    def _receive(self, message: bytes) -> None:
        self._newest = message

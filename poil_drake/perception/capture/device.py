"""What every RGB-D camera can do, wherever its images come from."""

from collections.abc import Callable
from typing import Protocol

from poil_drake.perception.images import RgbdImage

Clock = Callable[[], float]
"""The time now [s since the epoch]. Always passed in; it may be a scaled clock."""

PATIENCE = 0.1
"""How long `CaptureDevice.read` may wait for an image [s]."""


class CaptureDevice(Protocol):
    """One RGB-D camera. All calls come from one thread, the capture thread.

    The stamp of an image is when the light fell in, by the clock that the device was made with.
    """

    def open(self) -> None:
        """Opens the camera; this may take seconds. After `close` it may be opened again.

        Raises:
            CaptureError: naming the camera, what was found instead, and the remedy.
        """

    def read(self) -> RgbdImage | None:
        """Waits a short while, 0.1 s at most, for a new image.

        Returns:
            The image, whose arrays nobody writes to again; None where none came.

        Raises:
            NoImageError: when an image cannot be used, or none will come any more. The camera stays
                open, and the next `read` may bring a good one.
            CaptureError: when the camera is gone: it is to be closed and opened again.
        """

    def close(self) -> None:
        """Lets go of the camera. It never raises, and a second call does nothing."""

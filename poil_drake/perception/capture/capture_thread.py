"""Reads one camera on a thread of its own and keeps its newest image."""

import math
import threading

from poil_drake.errors import InvalidValueError, NoImageError, PoilError
from poil_drake.perception.capture.device import CaptureDevice
from poil_drake.perception.images import RgbdImage

_PAUSE = 0.001
"""After a read that brought nothing new [s]: a device that does not wait must not spin."""

_GRACE = 1.0
"""How long `close` waits for the thread [s]. A device may block for longer while it opens."""


class CaptureThread:
    """Opens a camera, reads it, and keeps the newest image that can be used.

    What cannot be used is never shown: an image of another size, one without any depth, one whose
    stamp is not finite or not later than the last one's since the device was opened, and whatever
    the device itself refuses with a `NoImageError`. Then, and when the device fails, `problem` says
    so, and the last image stays, so that its age grows: whoever uses it sees a frozen camera by the
    age alone. A device that fails otherwise is closed and opened again, both after `reopen_period`:
    some cameras' libraries hold Python up for both. The next image that can be used clears
    `problem`.

    The attributes may be read by any thread, without a lock.

    Attributes:
        newest: The newest image; None before the first.
        count: How many images were taken so far.
        problem: What is wrong; empty while all is well.
    """

    newest: RgbdImage | None
    count: int
    problem: str

    def __init__(
        self,
        device: CaptureDevice,
        *,
        name: str,
        size: tuple[int, int],
        reopen_period: float = 1.0,
    ):
        """Makes the thread; `start` starts it.

        Args:
            device: The camera. From now on only this thread uses it.
            name: The camera's name, for the name of the thread.
            size: (height, width) that images must have [px].
            reopen_period: From a failure to the next try to open the device [s].

        Raises:
            InvalidValueError: if the period is not positive.
        """
        if not reopen_period > 0.0:
            raise InvalidValueError(
                f"CaptureThread.reopen_period is {reopen_period}.", remedy="It must be positive."
            )
        self.newest, self.count, self.problem = None, 0, ""
        self._last_stamp = -math.inf
        self._device, self._size, self._reopen_period = device, size, reopen_period
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"capture_{name}", daemon=True)

    def start(self) -> None:
        """Starts to capture; once. After `close` it does nothing."""
        if not self._ended.is_set():
            self._thread.start()

    def close(self) -> None:
        """Ends the thread, which closes the device. A second call does nothing.

        A thread that is still inside its device after a second is left behind: it ends by itself,
        at the latest with the program.
        """
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join(_GRACE)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._device.open()
                # Of an earlier opening it says nothing: the clock may have been set since.
                self._last_stamp = -math.inf
                self._capture()
            # Of whatever kind, e.g. from a camera's library: it is said, and tried again.
            except Exception as error:
                self.problem = _in_one_line(error)
            self._ended.wait(self._reopen_period)
            self._close_device()

    def _capture(self) -> None:
        while not self._ended.is_set():
            try:
                image = self._device.read()
            except NoImageError as error:
                self.problem = _in_one_line(error)
                image = None
            if image is None or not self._take(image):
                self._ended.wait(_PAUSE)

    def _take(self, image: RgbdImage) -> bool:
        """Shows an image, or says what is wrong with it."""
        self.problem = self._flaw(image)
        if self.problem:
            return False
        self.newest, self._last_stamp = image, image.stamp
        self.count += 1
        return True

    def _flaw(self, image: RgbdImage) -> str:
        if image.depth.shape != self._size:
            height, width = image.depth.shape
            return (
                f"it delivers {width} x {height} pixels, but the scenario says "
                f"{self._size[1]} x {self._size[0]}"
            )
        if not math.isfinite(image.stamp):
            return f"an image has the stamp {image.stamp}"
        if image.stamp <= self._last_stamp:
            return (
                f"an image stamped {image.stamp:.3f} s came after one stamped "
                f"{self._last_stamp:.3f} s: the camera is frozen, or its clock has jumped"
            )
        if not image.depth.any():
            return "its depth images are empty: the lens is covered, or all is too near"
        return ""

    def _close_device(self) -> None:
        try:
            self._device.close()
        except Exception as error:
            self.problem = self.problem or _in_one_line(error)


def _in_one_line(error: Exception) -> str:
    text = str(error) if isinstance(error, PoilError) else f"{type(error).__name__}: {error}"
    return " ".join(text.split()).rstrip(".")

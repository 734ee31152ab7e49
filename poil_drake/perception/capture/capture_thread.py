"""Reads a camera on its own thread and keeps its newest image."""

import math
import threading
from collections.abc import Callable, Mapping

from poil_drake.errors import NoImageError, NoMoreImagesError, PoilError
from poil_drake.perception.capture.device import CaptureDevice
from poil_drake.perception.images import RgbdImage

_PAUSE = 0.001
"""Pause after a read without a new image [s], so that a non-blocking device does not spin."""

AHEAD = 0.02
"""Images stamped farther in the future than this [s] show that the clocks differ."""

_JOIN_TIMEOUT = 1.0
"""How long `close` waits for the thread [s]. A device may block for longer while it opens."""


class CaptureThread:
    """Opens a camera, reads it, and keeps the newest usable image.

    An image is unusable if the device rejects it with a `NoImageError`, if it has the wrong size or
    no valid depth, or if its stamp is not finite. An image is also unusable if its stamp is not
    later than that of the last usable image since the device was opened. `problem` then gives the
    reason, and `newest` stays the last usable image. The next usable image clears `problem`.

    After any other error of the device, the thread waits for `reopen_period`, then closes and opens
    the device. A short period is harmful: some libraries hold the interpreter while opening.

    Any thread may read the attributes, without a lock.

    Attributes:
        newest: The newest image; None before the first.
        count: Number of usable images so far.
        unusable: Number of unusable images so far.
        problem: Why the camera delivers no usable image; empty if it does.
    """

    def __init__(
        self,
        device: CaptureDevice,
        *,
        name: str,
        size: tuple[int, int],
        reopen_period: float = 1.0,
        on_image: Callable[[RgbdImage], None] | None = None,
    ):
        """Constructs the thread without starting it.

        Args:
            device: The camera. From now on only this thread uses it.
            name: The camera's name, for the name of the thread.
            size: Required (height, width) of the images [px].
            reopen_period: Time from a failure to the next attempt to open the device [s].
            on_image: Called on the thread with each usable image; must return quickly.
        """
        self.newest: RgbdImage | None = None
        self.count, self.unusable, self.problem = 0, 0, ""
        self._on_image = on_image
        self._last_stamp = -math.inf
        self._device, self._size, self._reopen_period = device, size, reopen_period
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"capture_{name}", daemon=True)

    def start(self) -> None:
        """Starts the thread. Call this at most once. After `close` it does nothing."""
        if not self._ended.is_set():
            self._thread.start()

    def close(self) -> None:
        """Ends the thread, which closes the device. A second call does nothing.

        Returns after at most a second. A thread that is still blocked in its device ends later, at
        the latest with the program.
        """
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join(_JOIN_TIMEOUT)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._device.open()
                # The clock may have been reset since the device was last open.
                self._last_stamp = -math.inf
                self._capture()
            except Exception as error:  # A camera's library may raise any type.
                self.problem = _in_one_line(error)
            self._ended.wait(self._reopen_period)
            try:
                self._device.close()
            except Exception as error:
                self.problem = self.problem or _in_one_line(error)

    def _capture(self) -> None:
        while not self._ended.is_set():
            try:
                image = self._device.read()
            except NoImageError as error:
                self.problem = _in_one_line(error)
                self.unusable += not isinstance(error, NoMoreImagesError)
                image = None
            if image is not None:
                self.problem = self._problem_with(image)
                self.unusable += bool(self.problem)
            if image is None or self.problem:
                self._ended.wait(_PAUSE)
                continue
            self.newest, self._last_stamp = image, image.stamp
            self.count += 1
            if self._on_image is not None:
                self._on_image(image)

    def _problem_with(self, image: RgbdImage) -> str:
        if image.depth.shape != self._size:
            height, width = image.depth.shape
            return (
                f"the images have {width} x {height} pixels, but the scenario has "
                f"{self._size[1]} x {self._size[0]}"
            )
        if not math.isfinite(image.stamp):
            return f"an image has the stamp {image.stamp}, which is not finite"
        if image.stamp <= self._last_stamp:
            return (
                f"an image stamped {image.stamp:.3f} s came after one stamped "
                f"{self._last_stamp:.3f} s: the camera is frozen, or its clock has jumped"
            )
        if not image.depth.any():
            return "the depth images are empty: the lens is covered, or everything is too close"
        return ""


def camera_problems(
    threads: Mapping[str, CaptureThread], *, now: float, oldest: float
) -> dict[str, list[str]]:
    """Returns what is wrong with each camera, by name; empty for a camera that works.

    Args:
        threads: The cameras' threads, by name.
        now: The current time on the clock of the stamps [s].
        oldest: Largest age of the newest image of a camera that works [s].
    """
    problems: dict[str, list[str]] = {}
    for name, thread in threads.items():
        found = [thread.problem] if thread.problem else []
        age = 0.0 if thread.newest is None else now - thread.newest.stamp
        if age > oldest:
            found.append(f"no new image for {age:.1f} s")
        if age < -AHEAD:
            found.append(
                f"its images are stamped {-age:.2f} s in the future: are the clocks synchronized?"
            )
        problems[name] = found
    return problems


def _in_one_line(error: Exception) -> str:
    text = str(error) if isinstance(error, PoilError) else f"{type(error).__name__}: {error}"
    return " ".join(text.split()).rstrip(".")

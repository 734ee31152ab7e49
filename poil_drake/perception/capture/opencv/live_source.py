"""A live source of OpenCV, read as fast as it delivers."""

import threading
from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.perception.capture.device import Clock
from poil_drake.runtime.interpreter_turns import TURNS

_JOIN_TIMEOUT = 1.0
"""How long `stop` waits for the thread [s]. A source may block for longer."""


@dataclass(frozen=True, eq=False)
class Arrival:
    """An image as OpenCV delivers it, and when it arrived [s, by the clock]."""

    pixels: np.ndarray
    time: float


class LiveSource:
    """Reads a source on its own thread and keeps the newest image.

    A source that is read more slowly than it delivers would queue ever older images. The time of an
    image is when it is fetched from its driver. After a halt of this program, the few images that
    waited in the driver therefore look newer than they are.

    Attributes:
        newest: The newest image; None before the first.
        ended: Whether no more images will come.
    """

    newest: Arrival | None
    ended: bool

    def __init__(
        self, capture: cv2.VideoCapture, *, name: str, clock: Clock, changed: threading.Condition
    ):
        """Starts to read.

        Args:
            capture: The open source. From now on only the thread uses it; it also releases it.
            name: For the name of the thread.
            clock: The time now [s since the epoch].
            changed: Notified of each image and of the end.
        """
        self.newest, self.ended = None, False
        self._capture, self._clock, self._changed = capture, clock, changed
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"grab_{name}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread. A thread that is blocked in its source ends later."""
        self._stopped.set()
        self._thread.join(_JOIN_TIMEOUT)

    def _run(self) -> None:
        try:
            while not self._stopped.is_set() and self._capture.grab():
                time = self._clock()
                TURNS.wait()
                came, pixels = self._capture.retrieve()
                if came:
                    with self._changed:
                        self.newest = Arrival(pixels, time)
                        self._changed.notify_all()
        finally:
            self._capture.release()
            with self._changed:
                self.ended = True
                self._changed.notify_all()

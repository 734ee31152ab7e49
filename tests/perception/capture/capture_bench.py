"""A clock that tests set, images, and a scripted camera."""

import threading
from collections import deque

import numpy as np

from poil_drake.perception.images import CameraModel, RgbdImage

HEIGHT, WIDTH = 6, 8
SIZE = (HEIGHT, WIDTH)
K = np.array([[20.0, 0.0, 3.5], [0.0, 20.0, 2.5], [0.0, 0.0, 1.0]])
CAMERA = CameraModel("left", WIDTH, HEIGHT, K, np.eye(4))
TIMEOUT = 3600.0  # [s]; only a failing test waits that long.


class SettableClock:
    """A clock that stands still between settings."""

    def __init__(self, now: float = 1000.0):
        self.now = now

    def __call__(self) -> float:
        return self.now


def image(stamp: float, *, size: tuple[int, int] = SIZE, depth: float = 0.5) -> RgbdImage:
    return RgbdImage(np.full((*size, 3), 7, np.uint8), np.full(size, depth, np.float32), stamp)


class ScriptedDevice:
    """Delivers or raises what it is fed, and knows when the reader has processed all of it."""

    def __init__(self) -> None:
        self.opened = self.closed = 0
        self.threads: set[threading.Thread] = set()
        self._changed = threading.Condition()
        self._to_open: deque[BaseException] = deque()
        self._to_read: deque[object] = deque()
        self._in_hand = False

    def feed(self, *items: object) -> None:
        """Delivers images or raises errors, one per `read`; returns when they are processed."""
        with self._changed:
            self._to_read.extend(items)
            self._changed.notify_all()
            done = self._changed.wait_for(lambda: not self._to_read and not self._in_hand, TIMEOUT)
        assert done, "Nothing reads the device any more."

    def fail_to_open(self, *errors: BaseException) -> None:
        with self._changed:
            self._to_open.extend(errors)

    def wait_until_opened(self, times: int) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: self.opened >= times, TIMEOUT)

    def open(self) -> None:
        with self._changed:
            self.opened += 1
            self._deal()
            if self._to_open:
                raise self._to_open.popleft()

    def read(self) -> object:
        with self._changed:
            self._deal()
            self._changed.wait_for(lambda: self._to_read, 0.05)
            if not self._to_read:
                return None
            self._in_hand = True
            item = self._to_read.popleft()
        if isinstance(item, BaseException):
            raise item
        return item

    def close(self) -> None:
        with self._changed:
            self.closed += 1
            self._deal()

    def _deal(self) -> None:
        self.threads.add(threading.current_thread())
        self._in_hand = False
        self._changed.notify_all()

"""Trials for the tests of the pool, in a module that workers can import."""

import os
import signal
import threading
from pathlib import Path

import numpy as np

from poil_drake.errors import DetectionError


def drawn(offset: float, seed: int) -> tuple[int, float]:
    """Returns what depends on its arguments alone."""
    return seed, offset + np.random.default_rng(seed).normal()


def process(seed: int) -> int:
    """Returns which process it ran in."""
    return os.getpid()


def threads(seed: int) -> str:
    """Returns on how many cores linear algebra computes."""
    return os.environ["OMP_NUM_THREADS"]


def killed(folder: Path, seed: int, times: int) -> int:
    """Kills its worker, the first `times` times that it is run with this seed."""
    with open(folder / f"{seed}.runs", "a") as file:
        file.write("x")
    if len((folder / f"{seed}.runs").read_text()) <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return seed


def undetected(seed: int) -> int:
    """Raises an error of this package."""
    raise DetectionError(f"No mug in trial {seed}.", remedy="Look elsewhere.")


class UnreadableError(Exception):
    """An exception that pickle writes and cannot read back."""

    def __init__(self, first: str, second: str):
        super().__init__(f"{first} {second}")


def unreadable(seed: int) -> int:
    """Raises an error that does not cross to another process."""
    raise UnreadableError("strange", "trouble")


def unwritable(seed: int) -> object:
    """Returns what pickle cannot carry."""
    return threading.Lock()


def blocked(seed: int) -> set[int]:
    """Returns which signals do not reach its worker."""
    return set(signal.pthread_sigmask(signal.SIG_BLOCK, ()))


def endless(seed: int) -> None:
    """Tells that it has begun, and never ends."""
    os.write(1, b"begun\n")
    threading.Event().wait()

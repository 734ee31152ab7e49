"""Advances a simulator at the pace of the clock, and notes how well that went."""

import gc
import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import cv2
import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.runtime.interpreter_turns import TURNS

_SWITCH_INTERVAL = 1e-4
"""For so long another thread may keep the interpreter from the loop [s]."""

_TIDY_PERIOD = 1.0
"""Between two looks for young garbage [s]."""


@dataclass(frozen=True, kw_only=True)
class RealTimeLoopConfig:
    """How the loop keeps its pace.

    Attributes:
        time_scale: Seconds of the simulator per second.
        give_up: A loop that is so many periods late does not catch up: what it would do late, and
            hurriedly, is of no use. From then on it keeps its pace from where it is.
        pause: Share of the period after which it waits once more, so that what happens from then on
            in the period is not done early; 0: it does not.
    """

    time_scale: float = 1.0
    give_up: int = 3
    pause: float = 0.0


@dataclass
class LoopTiming:
    """When the ticks of a loop began and how long they took.

    Attributes:
        starts: When each began [s], by a clock of its own.
        lateness: How long after it was due each began [s].
        durations: How long each took, without waiting [s].
        missed: Ticks that were due while an earlier one was still to begin.
    """

    starts: list[float] = field(default_factory=list)
    lateness: list[float] = field(default_factory=list)
    durations: list[float] = field(default_factory=list)
    missed: int = 0

    def latest(self, ticks: int = 8) -> dict[str, float]:
        """Returns the worst of the last ticks, and how many were missed in all, for a log."""
        return {
            "lateness": max(self.lateness[-ticks:], default=math.nan),
            "duration": max(self.durations[-ticks:], default=math.nan),
            "missed": float(self.missed),
        }

    def figures(self) -> dict[str, float]:
        """Returns name (with its unit) -> value, for a run's summary."""
        figures = {"ticks": float(len(self.starts)), "missed_ticks": float(self.missed)}
        for name, values in (
            ("lateness", self.lateness),
            ("duration", self.durations),
            ("period", np.diff(self.starts)),
        ):
            if len(values):
                p50, p99, p999 = np.percentile(values, [50.0, 99.0, 99.9])
                figures |= {
                    f"tick_{name}_p50_ms": 1e3 * float(p50),
                    f"tick_{name}_p99_ms": 1e3 * float(p99),
                    f"tick_{name}_p999_ms": 1e3 * float(p999),
                    f"tick_{name}_max_ms": 1e3 * float(np.max(values)),
                }
        return figures


class RealTimeLoop:
    """Calls a simulator's AdvanceTo once a period, when it is due.

    Drake's own `target_realtime_rate` waits in C++ after each of its steps. This waits before each
    period, so that what arrives meanwhile is known to the update which follows, and, if it shall,
    within a period, so that commands go out at an even pace however long the update took. It leaves
    the interpreter to other threads while it waits (`InterpreterTurns`).

    Attributes:
        timing: Of all ticks so far.
    """

    def __init__(
        self,
        simulator: Simulator,
        *,
        period: float,
        config: RealTimeLoopConfig | None = None,
    ):
        """Keeps what it needs; the pace begins with the first `AdvanceTo`.

        Args:
            simulator: What to advance, as fast as it can.
            period: Of the ticks [s, of the simulator].
            config: The pace.
        """
        self._simulator, self._period = simulator, period
        self._config = config or RealTimeLoopConfig()
        self._context = simulator.get_mutable_context()
        self._due: float | None = None
        self._tidied, self._behind = 0.0, 0
        self.timing = LoopTiming()

    def AdvanceTo(self, boundary: float) -> None:
        """Ticks until the simulator's time is `boundary` [s], a multiple of the period."""
        try:
            self._tick_until(boundary)
        finally:
            TURNS.give()

    def _tick_until(self, boundary: float) -> None:
        step = self._period / self._config.time_scale
        pause = self._config.pause
        now = time.perf_counter()
        due = now if self._due is None else self._due
        ticks = round((boundary - self._context.get_time()) / self._period)
        first = round(self._context.get_time() / self._period) + 1
        timing = self.timing
        for tick in range(first, first + ticks):
            now = _wait_until(due, now)
            late = now - due
            behind = int(late / step)
            # Those that were missed before are late still, while it catches up.
            timing.missed += max(0, behind - self._behind)
            if behind >= self._config.give_up:
                due, behind = now, 0
            self._behind = behind
            waited = 0.0
            if pause:
                # To some time before: all that is due by then, and not what is due at it.
                self._simulator.AdvanceTo((tick - 1.0 + 0.5 * pause) * self._period)
                computed = time.perf_counter()
                waited = _wait_until(due + pause * step, computed) - computed
            self._simulator.AdvanceTo(tick * self._period)
            after = time.perf_counter()
            timing.starts.append(now)
            timing.lateness.append(late)
            timing.durations.append(after - now - waited)
            if after - self._tidied > _TIDY_PERIOD:
                gc.collect(0)
                self._tidied = after
            now = time.perf_counter()
            due += step
            self._due = due


def _wait_until(due: float, now: float) -> float:
    """Returns the time when the wait was over."""
    if now >= due:
        return now
    TURNS.give()
    while now < due:
        time.sleep(due - now)
        now = time.perf_counter()
    TURNS.take()
    return now


@contextmanager
def QuietInterpreter(*, collecting: bool = False) -> Iterator[None]:
    """Keeps garbage collection, and long turns of other threads, out of a loop.

    Imported libraries and the diagram stay; scanning them for garbage again and again is waste.
    OpenCV works on the thread that asks it to: its own would not have the loop's priority.

    Args:
        collecting: Whether what is new is scanned as ever, and threads take turns as ever: for a
            loop that nobody waits for.
    """
    interval, enabled = sys.getswitchinterval(), gc.isenabled()
    threads = cv2.getNumThreads()
    gc.collect()
    gc.freeze()
    if not collecting:
        gc.disable()
        sys.setswitchinterval(_SWITCH_INTERVAL)
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        cv2.setNumThreads(threads)
        if enabled:
            gc.enable()
        gc.unfreeze()

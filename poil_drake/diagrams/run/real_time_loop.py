"""Advances a simulator in real time, and records its timing."""

import gc
import math
import time
from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.runtime.interpreter_turns import TURNS

_GIVE_UP = 3
"""A loop that is late by this many periods does not catch up, but goes on at its normal pace. Late
commands in quick succession would be of no use."""

_COLLECTION_PERIOD = 1.0
"""Time between two garbage collections of Python's youngest objects [s]."""


@dataclass
class LoopTiming:
    """When the ticks of a loop began and how long they took.

    Attributes:
        starts: When each tick began [s], from an arbitrary zero.
        lateness: How late each tick began [s].
        durations: How long each tick took, without waiting [s].
        missed: Number of ticks that were already due when an earlier tick began.
    """

    starts: list[float] = field(default_factory=list)
    lateness: list[float] = field(default_factory=list)
    durations: list[float] = field(default_factory=list)
    missed: int = 0

    def latest(self, ticks: int = 8) -> dict[str, float]:
        """Returns the largest lateness and duration [s] of the last ticks, and `missed`."""
        return {
            "lateness": max(self.lateness[-ticks:], default=math.nan),
            "duration": max(self.durations[-ticks:], default=math.nan),
            "missed": float(self.missed),
        }

    def figures(self) -> dict[str, float]:
        """Returns the figures for a run's summary: name (with its unit) -> value."""
        figures = {"ticks": float(len(self.starts)), "missed_ticks": float(self.missed)}
        for name, values in (
            ("lateness", self.lateness),
            ("duration", self.durations),
            ("period", np.diff(self.starts)),
        ):
            if len(values):
                percentiles = np.percentile(values, [50.0, 99.0, 99.9, 100.0])
                for label, value in zip(("p50", "p99", "p999", "max"), percentiles, strict=True):
                    figures[f"tick_{name}_{label}_ms"] = 1e3 * float(value)
        return figures


class RealTimeLoop:
    """Advances a simulator in real time, by one period (a tick) at a time.

    Drake's own `target_realtime_rate` waits in C++ after each of the simulator's steps. This loop
    waits before each period, so that the update at the start of the period sees every message that
    has arrived. With a `pause`, it also waits within the period, so that commands leave at an even
    pace however long the update took. While it waits, other threads may use the interpreter
    (`InterpreterTurns`).

    Attributes:
        timing: The timing of all ticks so far.
    """

    def __init__(
        self,
        simulator: Simulator,
        *,
        period: float,
        time_scale: float = 1.0,
        pause: float = 0.0,
    ):
        """Constructs the loop. Real time counts from the first `AdvanceTo`.

        Args:
            simulator: The simulator to advance. Its target_realtime_rate must be 0.
            period: Period of the ticks [s, simulated].
            time_scale: Simulated seconds per second of real time.
            pause: Fraction of the period at which the loop waits again after the period's first
                update. Later events then do not happen early. With 0, there is no second wait.
        """
        self._simulator, self._period = simulator, period
        self._time_scale, self._pause = time_scale, pause
        self._context = simulator.get_mutable_context()
        self._due: float | None = None
        self._collected, self._behind = 0.0, 0
        self.timing = LoopTiming()

    def AdvanceTo(self, boundary: float) -> None:
        """Advances until the simulated time is `boundary` [s], a multiple of the period."""
        try:
            done = round(self._context.get_time() / self._period)
            for tick in range(done + 1, round(boundary / self._period) + 1):
                self._tick(tick)
        finally:
            TURNS.give()

    def _tick(self, tick: int) -> None:
        step = self._period / self._time_scale
        now = time.perf_counter()
        due = now if self._due is None else self._due
        now = _wait_until(due, now)
        late = now - due
        behind = int(late / step)
        # While the loop catches up, ticks counted as missed before are late again.
        self.timing.missed += max(0, behind - self._behind)
        if behind >= _GIVE_UP:
            due, behind = now, 0
        self._behind = behind
        waited = 0.0
        if self._pause:
            # Halfway to the pause, so that only the events that are due after it wait.
            self._simulator.AdvanceTo((tick - 1.0 + 0.5 * self._pause) * self._period)
            computed = time.perf_counter()
            waited = _wait_until(due + self._pause * step, computed) - computed
        self._simulator.AdvanceTo(tick * self._period)
        after = time.perf_counter()
        self.timing.starts.append(now)
        self.timing.lateness.append(late)
        self.timing.durations.append(after - now - waited)
        if after - self._collected > _COLLECTION_PERIOD:
            gc.collect(0)
            self._collected = after
        self._due = due + step


def _wait_until(due: float, now: float) -> float:
    """Waits until `time.perf_counter` is `due`, if that is after `now`; returns its new value."""
    if now >= due:
        return now
    TURNS.give()
    while now < due:
        time.sleep(due - now)
        now = time.perf_counter()
    TURNS.take()
    return now

"""The summary of a run: one line for people, one JSON file for programs."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.recording.mcap.library_versions import library_versions
from poil_drake.recording.mcap.plain_json import plain_json, write_json


@dataclass(frozen=True, kw_only=True)
class PhaseSpan:
    """A phase of the skill, from its start to its end [s, simulated]."""

    name: str
    start: float
    end: float


@dataclass(frozen=True, kw_only=True)
class ErrorStatistics:
    """Statistics of an error over a run [m]; NaN if nothing was measured.

    Attributes:
        count: Number of finite samples.
        median: Median of the finite samples.
        percentile_95: Their 95th percentile.
        maximum: The largest finite sample.
        final: The last finite sample.
        missing: Share of the samples that are not finite.
    """

    count: int
    median: float
    percentile_95: float
    maximum: float
    final: float
    missing: float = 0.0

    @classmethod
    def of(cls, errors: np.ndarray) -> "ErrorStatistics":
        """Returns the statistics of errors [m], an array of any shape."""
        samples = np.asarray(errors, dtype=float).ravel()
        values = samples[np.isfinite(samples)]
        shown = values if values.size else np.array([math.nan])
        median, percentile_95 = np.percentile(shown, [50.0, 95.0])
        return cls(
            count=values.size,
            median=float(median),
            percentile_95=float(percentile_95),
            maximum=float(shown.max()),
            final=float(shown[-1]),
            missing=1.0 - values.size / samples.size if samples.size else 0.0,
        )


@dataclass(frozen=True, kw_only=True)
class RunTiming:
    """How long a run took.

    Attributes:
        simulated: Simulated time [s].
        wall: Wall-clock time of the simulation [s].
        parts: Wall-clock time by kind of work [s]; they add up to `wall`. "capture" includes the
            rendering of images, unless the cameras delay their images; "waiting" is the wait for
            other processes; "physics" is the rest, including sleep for a real-time rate.
        concurrent: Wall-clock time for which other processes work [s]: "rendering" if the cameras
            delay their images, and "tracking".
        stages: Wall-clock time of each stage of the job [s]: demonstration, planning, execution
            (building the loop and simulating it), report (finishing log, recording, picture).
    """

    simulated: float
    wall: float
    parts: Mapping[str, float] = field(default_factory=dict)
    concurrent: Mapping[str, float] = field(default_factory=dict)
    stages: Mapping[str, float] = field(default_factory=dict)

    @property
    def real_time_factor(self) -> float:
        """Simulated time per wall-clock time; 1 is real time. NaN without a simulation."""
        return self.simulated / self.wall if self.wall > 0.0 else math.nan


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """The outcome of a run.

    Attributes:
        success: Whether the task succeeded.
        reason: Why it succeeded or failed, in one clause, e.g. "the mug hung for 2.0 s".
        losses: How often and for how long tracks were lost, in one clause; empty if never.
        scenario: The scenario's name.
        scenario_file: Path of the scenario's file.
        seed: The seed of all randomness.
        timing: How long the run took.
        phases: The skill's phases in order.
        mean_error: Mean distance of the points from the reference's last points when the phase
            `follow` ends [m].
        initial_potential: D of POIL eq. 4 when `follow` starts [m^2].
        final_potential: D when `follow` ends [m^2].
        tracking_error: Distance of tracked points from the true ones; None if those are unknown.
        carried_tracking_error: The tracking error while the object is carried. In the other phases
            the object mostly rests, so tracking it is easier.
        outputs: Paths of the files written, by kind.
        versions: Versions of the libraries, by name.
        tracker: The tracker's name.
        final_state_digest: SHA-256 of the simulated plant's final positions and velocities. Two
            runs of the same scenario with the same seed have the same digest.
        figures: Further measurements by name; the name contains the unit.
    """

    success: bool
    reason: str
    losses: str = ""
    scenario: str = ""
    scenario_file: str = ""
    seed: int = 0
    timing: RunTiming
    phases: Sequence[PhaseSpan] = ()
    mean_error: float = math.nan
    initial_potential: float = math.nan
    final_potential: float = math.nan
    tracking_error: ErrorStatistics | None = None
    carried_tracking_error: ErrorStatistics | None = None
    outputs: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=library_versions)
    tracker: str = ""
    final_state_digest: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)

    def closing_line(self) -> str:
        """Returns the one line that ends a run's output."""
        timing = self.timing
        clauses = [self.reason, *([self.losses] if self.losses else [])]
        if math.isfinite(self.mean_error):
            clauses.append(f"mean point error {self.mean_error * 1e3:.1f} mm")
        if self.tracking_error is not None and self.tracking_error.count:
            clauses.append(f"tracking error {self.tracking_error.median * 1e3:.1f} mm (median)")
        if timing.wall > 0.0:
            # Only a run in real time has an epoch.
            lived = "passed" if "epoch_s" in self.figures else "simulated"
            clauses.append(
                f"{timing.simulated:.1f} s {lived} in {timing.wall:.1f} s "
                f"({timing.real_time_factor:.2f}x real time)"
            )
        return f"{'SUCCESS' if self.success else 'FAILURE'}: {'; '.join(clauses)}."

    def to_dict(self) -> dict[str, Any]:
        """Returns all fields as JSON values; numbers that are not finite become None."""
        values = dataclasses.asdict(self)
        values["timing"]["real_time_factor"] = self.timing.real_time_factor
        return plain_json(values)

    def write_json(self, path: str | Path) -> Path:
        """Writes all fields as JSON, creates the folder if needed, and returns the path."""
        write_json(self.to_dict(), Path(path))
        return Path(path)


def phase_spans(
    times: np.ndarray, phases: np.ndarray, names: Sequence[str]
) -> tuple[PhaseSpan, ...]:
    """Returns start and end of each phase, given sampled indices of the current phase.

    Args:
        times: (T,) sample times [s].
        phases: (T,) index of the phase at each time.
        names: Names of the phases, by index.
    """
    times, indices = np.asarray(times), np.asarray(phases).astype(int).ravel()
    if times.size == 0:
        return ()
    first = np.flatnonzero(np.r_[True, np.diff(indices) != 0])
    ends = np.r_[times[first[1:]], times[-1]]
    return tuple(
        PhaseSpan(name=names[indices[i]], start=float(times[i]), end=float(end))
        for i, end in zip(first, ends, strict=True)
    )

"""How two runs differ that had the same inputs: a run, and its replay."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from poil_drake.recording.recorded_run import PhaseStart, RecordedRun
from poil_drake.recording.series import Series

JOINT_VELOCITY = "joint_velocity_rad_s"
ANGULAR_VELOCITY = "angular_velocity_rad_s"
LINEAR_VELOCITY = "linear_velocity_m_s"
TRACKED_POINTS = "tracked_points_m"


@dataclass(frozen=True, kw_only=True)
class ReplayTolerances:
    """Up to which differences two runs count as the same.

    Attributes:
        joint_velocity: Of each joint's commanded velocity [rad/s].
        angular_velocity: Of the gripper's angular velocity asked for [rad/s].
        linear_velocity: Of its linear velocity asked for [m/s].
        tracked_points: Of each tracked point [m], in the phases in which they move the arm.
        phase_start: Of the time at which a phase begins [s].
        point_phases: The phases in which the points move the arm. In others nothing depends on
            them, and a hand that lets go hides them.
    """

    joint_velocity: float
    angular_velocity: float
    linear_velocity: float
    tracked_points: float
    phase_start: float
    point_phases: tuple[str, ...] = ("follow",)

    def of(self, signal: str) -> float:
        """Returns the tolerance of a signal."""
        return {
            JOINT_VELOCITY: self.joint_velocity,
            ANGULAR_VELOCITY: self.angular_velocity,
            LINEAR_VELOCITY: self.linear_velocity,
            TRACKED_POINTS: self.tracked_points,
        }[signal]


@dataclass(frozen=True, kw_only=True)
class DifferenceStatistics:
    """Size of a difference, NaN where nothing was compared.

    Attributes:
        count: Number of samples.
        median: Median.
        percentile_95: What 95 percent of the samples do not exceed.
        maximum: Largest.
    """

    count: int
    median: float
    percentile_95: float
    maximum: float

    @classmethod
    def of(cls, values: np.ndarray) -> "DifferenceStatistics":
        """Returns the statistics of some differences; NaN among them are left out."""
        known = values[~np.isnan(values)]
        if not known.size:
            return cls(count=0, median=math.nan, percentile_95=math.nan, maximum=math.nan)
        # Of the samples themselves, as there may be infinite ones, between which nothing is.
        median, percentile_95 = np.percentile(known, [50.0, 95.0], method="higher")
        return cls(
            count=known.size,
            median=float(median),
            percentile_95=float(percentile_95),
            maximum=float(known.max()),
        )


@dataclass(frozen=True, kw_only=True)
class PhaseComparison:
    """A phase, and when it began in the run and in its replay [s]; NaN where it did not."""

    name: str
    recorded: float
    replayed: float


@dataclass(frozen=True, kw_only=True)
class FirstDifference:
    """Where two runs part.

    Attributes:
        time: When [s].
        what: A signal, or "phase".
        phase: The phase of the recorded run.
        size: How large the difference is, in the signal's unit, or [s]; infinite where only one
            of the two has it.
    """

    time: float
    what: str
    phase: str
    size: float


@dataclass(frozen=True, kw_only=True, eq=False)
class RunComparison:
    """How a replay differs from the run.

    Attributes:
        differences: Signal -> its differences, infinite where only one of the two is finite.
        phases: The phases of both, in order.
        spans: Each phase of the recorded run: name, start and end [s].
        tolerances: What was tolerated.
        unmatched_tracks: How many tracks only one of the two has.
        visibility: How many points only one of the two saw, over all tracks.
    """

    differences: Mapping[str, Series]
    phases: Sequence[PhaseComparison]
    spans: Sequence[tuple[str, float, float]]
    tolerances: ReplayTolerances
    unmatched_tracks: int = 0
    visibility: int = 0
    first: FirstDifference | None = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "first", self._first())

    @property
    def same(self) -> bool:
        """Whether anything was compared, and no difference is above its tolerance."""
        return self.first is None and self.statistics(JOINT_VELOCITY).count > 0

    @property
    def phases_agree(self) -> bool:
        """Whether the same phases began at the same times."""
        return not any(self._parts(phase) for phase in self.phases)

    def statistics(self, signal: str) -> DifferenceStatistics:
        """Returns the statistics of a signal's differences over the run."""
        return DifferenceStatistics.of(self.differences[signal].values[:, 0])

    def statistics_by_phase(self, signal: str) -> dict[str, DifferenceStatistics]:
        """Returns the same for each phase of the recorded run."""
        series = self.differences[signal]
        found = {}
        for name, start, end in self.spans:
            inside = (series.times >= start) & (series.times < end)
            found[name] = DifferenceStatistics.of(series.values[inside, 0])
        return found

    def _parts(self, phase: PhaseComparison) -> bool:
        end = self.spans[-1][2] if self.spans else math.inf
        if math.isnan(phase.replayed) and phase.recorded > end - self.tolerances.phase_start:
            return False  # It may yet have come.
        return not abs(phase.recorded - phase.replayed) <= self.tolerances.phase_start

    def _judged(self, signal: str) -> np.ndarray:
        """Returns which samples (T,) of a signal must be within its tolerance."""
        times = self.differences[signal].times
        if signal != TRACKED_POINTS:
            return np.full(len(times), True)
        wanted = self.tolerances.point_phases
        return np.array([self._phase_at(time) in wanted for time in times], dtype=bool)

    def _first(self) -> FirstDifference | None:
        found = []
        for signal, series in self.differences.items():
            apart = series.values[:, 0] > self.tolerances.of(signal)
            above = np.flatnonzero(apart & self._judged(signal))
            if above.size:
                found.append((series.times[above[0]], signal, series.values[above[0], 0]))
        for phase in self.phases:
            if self._parts(phase):
                both = (phase.recorded, phase.replayed)
                gap = abs(both[0] - both[1])
                size = math.inf if math.isnan(gap) else gap
                found.append((float(np.nanmin(both)), "phase", size))
        if not found:
            return None
        time, what, size = min(found)
        return FirstDifference(
            time=float(time), what=what, phase=self._phase_at(time), size=float(size)
        )

    def _phase_at(self, time: float) -> str:
        names = [name for name, start, _ in self.spans if start <= time]
        return names[-1] if names else ""


def compare_runs(
    recorded: RecordedRun, replayed: RecordedRun, tolerances: ReplayTolerances
) -> RunComparison:
    """Compares two runs at the sample times that both have.

    Args:
        recorded: The run.
        replayed: Its replay.
        tolerances: What is tolerated.
    """
    commands = _pairs(recorded.commands, replayed.commands)
    twists = _pairs(recorded.twist, replayed.twist)
    tracks, unmatched, visibility = _compare_tracks(recorded, replayed)
    return RunComparison(
        differences={
            JOINT_VELOCITY: _largest(*commands),
            ANGULAR_VELOCITY: _lengths(*twists, slice(0, 3)),
            LINEAR_VELOCITY: _lengths(*twists, slice(3, 6)),
            TRACKED_POINTS: tracks,
        },
        phases=_compare_phases(recorded.phases, replayed.phases),
        spans=_spans(recorded),
        tolerances=tolerances,
        unmatched_tracks=unmatched,
        visibility=visibility,
    )


def _pairs(a: Series, b: Series) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the common times of two series, and the values of both."""
    in_ns = [np.rint(1e9 * series.times).astype(np.int64) for series in (a, b)]
    _, in_a, in_b = np.intersect1d(in_ns[0], in_ns[1], return_indices=True)
    return a.times[in_a], a.values[in_a], b.values[in_b]


def _largest(times: np.ndarray, a: np.ndarray, b: np.ndarray) -> Series:
    """Returns the largest difference (T, 1) of the elements of each row."""
    return Series(times, np.max(np.abs(_difference(a, b)), axis=1, initial=0.0)[:, None])


def _lengths(times: np.ndarray, a: np.ndarray, b: np.ndarray, part: slice) -> Series:
    """Returns the length (T, 1) of the difference of a part of each row."""
    return Series(times, np.linalg.norm(_difference(a, b)[:, part], axis=1)[:, None])


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns a - b; zero where neither is finite, and infinite where only one of them is."""
    known = np.isfinite(a), np.isfinite(b)
    difference = np.subtract(a, b, out=np.zeros_like(a), where=known[0] & known[1])
    return np.where(known[0] != known[1], np.inf, difference)


def _compare_tracks(recorded: RecordedRun, replayed: RecordedRun) -> tuple[Series, int, int]:
    """Returns the largest distance (T, 1) of the points that both saw, for each pair of tracks."""
    ours = {round(1e9 * logged.track.stamp): logged for logged in recorded.tracks}
    others = {round(1e9 * logged.track.stamp): logged.track for logged in replayed.tracks}
    samples, visibility = [], 0
    for stamp in sorted(ours.keys() & others.keys()):
        a, b = ours[stamp].track, others[stamp]
        if len(a.positions) != len(b.positions):
            samples.append((ours[stamp].time, [math.inf]))
            continue
        seen = a.confidence > 0.0, b.confidence > 0.0
        visibility += int(np.count_nonzero(seen[0] != seen[1]))
        distances = np.linalg.norm(a.positions - b.positions, axis=1)[seen[0] & seen[1]]
        samples.append((ours[stamp].time, [distances.max() if distances.size else math.nan]))
    return Series.of(samples, 1), len(ours.keys() ^ others.keys()), visibility


def _compare_phases(
    recorded: Sequence[PhaseStart], replayed: Sequence[PhaseStart]
) -> tuple[PhaseComparison, ...]:
    """Returns the phases of both side by side as long as they are the same, and then all others."""
    same = 0
    while same < min(len(recorded), len(replayed)) and (recorded[same].name == replayed[same].name):
        same += 1
    pairs = [
        PhaseComparison(name=a.name, recorded=a.time, replayed=b.time)
        for a, b in zip(recorded[:same], replayed[:same], strict=True)
    ]
    pairs += [
        PhaseComparison(name=a.name, recorded=a.time, replayed=math.nan) for a in recorded[same:]
    ]
    pairs += [
        PhaseComparison(name=b.name, recorded=math.nan, replayed=b.time) for b in replayed[same:]
    ]
    return tuple(pairs)


def _spans(run: RecordedRun) -> tuple[tuple[str, float, float], ...]:
    """Returns the phases; the last one ends after the last sample."""
    starts = [phase.time for phase in run.phases]
    last = math.nextafter(max([run.end, *starts]), math.inf)
    ends = [*starts[1:], last][: len(starts)]
    names = [phase.name for phase in run.phases]
    return tuple(zip(names, starts, ends, strict=True))

"""Compares a run with its replay, which had the same inputs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile

import numpy as np

from poil_drake.recording.comparison.differences import SignalPair, TrackComparison, compare_tracks
from poil_drake.recording.comparison.tolerances import (
    ANGULAR_VELOCITY,
    JOINT_VELOCITY,
    LINEAR_VELOCITY,
    TRACKED_POINTS,
    ReplayTolerances,
)
from poil_drake.recording.run_log.recorded_run import PhaseStart, RecordedRun, Series

PHASE, TRACKS = "phase", "tracks"
"""Values of `FirstDifference.what` besides the names of signals."""


@dataclass(frozen=True, kw_only=True)
class DifferenceStatistics:
    """Statistics of the sizes of differences. All but `count` are NaN if nothing was compared.

    Attributes:
        count: Number of samples.
        median: Median.
        percentile_95: 95th percentile.
        maximum: Maximum.
    """

    count: int
    median: float
    percentile_95: float
    maximum: float

    @classmethod
    def of(cls, values: np.ndarray) -> "DifferenceStatistics":
        """Returns the statistics of the values that are not NaN."""
        known = values[~np.isnan(values)]
        # Each percentile is one of the samples, because infinite samples cannot be interpolated.
        percentiles = np.percentile(known if known.size else np.nan, [50, 95, 100], method="higher")
        median, percentile_95, maximum = percentiles.tolist()
        return cls(count=known.size, median=median, percentile_95=percentile_95, maximum=maximum)


@dataclass(frozen=True, kw_only=True)
class PhaseComparison:
    """The start times of a phase in a run and in its replay [s]; NaN where it does not occur."""

    name: str
    recorded: float
    replayed: float

    @property
    def alone(self) -> bool:
        """Whether the phase occurs in only one of the two runs."""
        return math.isnan(self.recorded) or math.isnan(self.replayed)


@dataclass(frozen=True, kw_only=True)
class FirstDifference:
    """Where two runs begin to differ.

    Attributes:
        time: Time of the first difference [s].
        what: What differs: the name of a signal, `PHASE` or `TRACKS`.
        phase: The phase of the recorded run at `time`.
        size: Size of the difference. For a signal, it is in the signal's unit; for `PHASE`, it is
            the time between both starts [s]; for `TRACKS`, the share of tracks that cannot be
            compared. Infinite if only one run has the value or the phase.
        tolerance: The tolerance that `size` exceeds.
        began: The phase that differs, if `what` is `PHASE`; otherwise None.
    """

    time: float
    what: str
    phase: str
    size: float
    tolerance: float
    began: PhaseComparison | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class RunComparison:
    """How a replay differs from its run.

    Attributes:
        differences: Signal -> its (T, 1) differences; infinite where only one run's value is
            finite.
        judged: Signal -> the (T, 1) differences to which the tolerances apply. While points move
            the arm, and for `ReplayTolerances.phase_start` afterwards, those of a velocity allow a
            delay of up to `ReplayTolerances.shift` of either run; see `SignalPair.differences`.
        phases: The phases of both runs.
        spans: Name, start and end [s] of each phase of the recorded run.
        tolerances: The differences up to which the runs count as the same.
        tracks: How the tracks differ.
        commands: Number of command samples in the recorded run.
    """

    differences: Mapping[str, Series]
    judged: Mapping[str, Series]
    phases: Sequence[PhaseComparison]
    spans: Sequence[tuple[str, float, float]]
    tolerances: ReplayTolerances
    tracks: TrackComparison
    commands: int

    @cached_property
    def first(self) -> FirstDifference | None:
        """The earliest difference that exceeds its tolerance; None if there is none."""
        found = [*self._signals_above(), *self._phases_apart(), *self._tracks_missing()]
        return min(found, key=lambda difference: difference.time, default=None)

    @property
    def same(self) -> bool:
        """Whether joint velocities were compared and no difference exceeds its tolerance."""
        return self.first is None and self.statistics(JOINT_VELOCITY).count > 0

    @property
    def phases_agree(self) -> bool:
        """Whether the same phases began at the same times, within the tolerance."""
        return not any(self._differs(phase) for phase in self.phases)

    def statistics(self, signal: str) -> DifferenceStatistics:
        """Returns the statistics of a signal's differences over the whole run."""
        return DifferenceStatistics.of(self.differences[signal].values[:, 0])

    def statistics_by_phase(self, signal: str) -> dict[str, DifferenceStatistics]:
        """Returns the statistics of a signal's differences in each phase of the recorded run."""
        series = self.differences[signal]
        found = {}
        for name, start, end in self.spans:
            inside = (series.times >= start) & (series.times < end)
            found[name] = DifferenceStatistics.of(series.values[inside, 0])
        return found

    def limits(self, signal: str) -> np.ndarray:
        """Returns the (T,) tolerances of the differences in `judged`; infinite where none applies.

        While points move the arm, the tolerance is `ReplayTolerances.of`. At other times, tracked
        points have none, and velocities have that of `ReplayTolerances.elsewhere`. Velocities keep
        `ReplayTolerances.of` in two cases: for `ReplayTolerances.phase_start` after points moved
        the arm, and while the runs are in different phases or began a phase at different times.
        """
        times, tolerances = self.differences[signal].times, self.tolerances
        usual, strict = tolerances.of(signal), tolerances.elsewhere
        if signal == TRACKED_POINTS:
            return np.where(_moved(times, self.spans, tolerances), usual, math.inf)
        limits = np.full(len(times), usual)
        if strict is not None:
            for start, end in self._common_spans(strict.phase_start):
                limits[(times >= start) & (times < end)] = strict.of(signal)
        limits[_moved(times, self.spans, tolerances, fading=tolerances.phase_start)] = usual
        return limits

    def judged_maximum(self, signal: str) -> float:
        """Returns the largest of a signal's `judged` differences; NaN if there is none.

        Considers only the times at which its tolerance in `limits` is `ReplayTolerances.of`.
        """
        held = self.limits(signal) == self.tolerances.of(signal)
        return DifferenceStatistics.of(self.judged[signal].values[held, 0]).maximum

    def _common_spans(self, tolerance: float) -> Iterator[tuple[float, float]]:
        """Yields start and end [s] of the time that both runs spend in each phase.

        Omits phases whose starts in the two runs differ by more than `tolerance` [s].
        """
        begun = [phase for phase in self.phases if not math.isnan(phase.recorded)]
        for k, (phase, (_, start, end)) in enumerate(zip(begun, self.spans, strict=True)):
            if abs(phase.recorded - phase.replayed) <= tolerance:
                left = begun[k + 1].replayed if k + 1 < len(begun) else math.nan
                yield start, float(np.fmin(end, left))

    def _differs(self, phase: PhaseComparison) -> bool:
        end = self.spans[-1][2] if self.spans else math.inf
        starts, late = (phase.recorded, phase.replayed), self.tolerances.phase_start
        alone = {math.isnan(other.recorded) for other in self.phases if other.alone}
        if phase.alone and len(alone) == 1 and np.nanmin(starts) > end - late:
            return False  # The other run may have ended just before this phase.
        return not abs(starts[0] - starts[1]) <= late

    def _difference(
        self, time: float, what: str, size: float, tolerance: float, **began: PhaseComparison
    ) -> FirstDifference:
        phase = self._phase_at(time)
        return FirstDifference(
            time=time, what=what, phase=phase, size=size, tolerance=tolerance, **began
        )

    def _signals_above(self) -> Iterator[FirstDifference]:
        for signal, series in self.judged.items():
            limits = self.limits(signal)
            for k in np.flatnonzero(series.values[:, 0] > limits)[:1]:
                yield self._difference(
                    float(series.times[k]), signal, float(series.values[k, 0]), float(limits[k])
                )

    def _phases_apart(self) -> Iterator[FirstDifference]:
        for phase in filter(self._differs, self.phases):
            size = math.inf if phase.alone else abs(phase.recorded - phase.replayed)
            time = float(np.nanmin((phase.recorded, phase.replayed)))
            tolerance = self.tolerances.phase_start
            yield self._difference(time, PHASE, size, tolerance, began=phase)

    def _tracks_missing(self) -> Iterator[FirstDifference]:
        wanted, tolerance = self.tolerances.point_phases, self.tolerances.unmatched_tracks
        judged = [pair for pair in self.tracks.pairs if self._phase_at(pair[0]) in wanted]
        times = [time for time, comparable in judged if not comparable]
        share = len(times) / max(len(judged), 1)
        if share > tolerance:
            yield self._difference(min(times), TRACKS, share, tolerance)

    def _phase_at(self, time: float) -> str:
        names = [name for name, start, _ in self.spans if start <= time]
        return names[-1] if names else ""


def compare_runs(
    recorded: RecordedRun, replayed: RecordedRun, tolerances: ReplayTolerances
) -> RunComparison:
    """Compares two runs at the sample times that they have in common.

    Args:
        recorded: The run.
        replayed: The replay of that run.
        tolerances: The differences up to which the two count as the same.
    """
    commands = SignalPair.of(recorded.commands, replayed.commands)
    twists = SignalPair.of(recorded.twist, replayed.twist)
    tracks = compare_tracks(recorded.tracks, replayed.tracks)
    plain = _velocity_differences(commands, twists, shift=0.0)
    left = _velocity_differences(commands, twists, shift=tolerances.shift)
    spans = _spans(recorded)
    judged = {}
    for signal, series in plain.items():
        moved = _moved(series.times, spans, tolerances, fading=tolerances.phase_start)
        values = np.where(moved[:, None], left[signal].values, series.values)
        judged[signal] = Series(series.times, values)
    return RunComparison(
        differences={**plain, TRACKED_POINTS: tracks.distances},
        judged={**judged, TRACKED_POINTS: tracks.distances},
        phases=_compare_phases(recorded.phases, replayed.phases),
        spans=spans,
        tolerances=tolerances,
        tracks=tracks,
        commands=len(recorded.commands),
    )


def _moved(
    times: np.ndarray,
    spans: Sequence[tuple[str, float, float]],
    tolerances: ReplayTolerances,
    *,
    fading: float = 0.0,
) -> np.ndarray:
    """Returns (T,) whether points move the arm at `times` [s], or did up to `fading` [s] before."""
    moved = np.zeros(len(times), dtype=bool)
    for name, start, end in spans:
        if name in tolerances.point_phases:
            moved |= (times >= start) & (times < end + fading)
    return moved


def _velocity_differences(
    commands: SignalPair, twists: SignalPair, *, shift: float
) -> dict[str, Series]:
    """Returns the (T, 1) differences of each velocity; see `SignalPair.differences` for `shift`."""
    joints, twist = commands.differences(shift), twists.differences(shift)
    largest = np.max(joints, axis=1, initial=0.0)
    angular, linear = (np.linalg.norm(part, axis=1) for part in (twist[:, :3], twist[:, 3:]))
    return {
        JOINT_VELOCITY: Series(commands.times, largest[:, None]),
        ANGULAR_VELOCITY: Series(twists.times, angular[:, None]),
        LINEAR_VELOCITY: Series(twists.times, linear[:, None]),
    }


def _compare_phases(
    recorded: Sequence[PhaseStart], replayed: Sequence[PhaseStart]
) -> tuple[PhaseComparison, ...]:
    """Pairs the phases of both runs up to the first that differs. Later phases have no partner."""
    pairs = zip(recorded, replayed, strict=False)
    same = sum(1 for _ in takewhile(lambda pair: pair[0].name == pair[1].name, pairs))
    rows = [
        *((a.name, a.time, b.time) for a, b in zip(recorded[:same], replayed, strict=False)),
        *((a.name, a.time, math.nan) for a in recorded[same:]),
        *((b.name, math.nan, b.time) for b in replayed[same:]),
    ]
    return tuple(PhaseComparison(name=name, recorded=a, replayed=b) for name, a, b in rows)


def _spans(run: RecordedRun) -> tuple[tuple[str, float, float], ...]:
    """Returns name, start and end [s] of each phase; the last phase ends after the last sample."""
    starts = [phase.time for phase in run.phases]
    last = math.nextafter(max([run.end, *starts]), math.inf)
    ends = [*starts[1:], last]
    return tuple((p.name, p.time, end) for p, end in zip(run.phases, ends, strict=False))

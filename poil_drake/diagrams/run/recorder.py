"""Samples a closed loop for the summary of its run. The loop does not depend on the samples."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import Context

from poil_drake.diagrams.loop.closed_loop import ClosedLoop
from poil_drake.diagrams.run.task_success import HangingJudge, SimulatedTruth
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import Fault, Phase
from poil_drake.systems.statuses import TrackerStatus

_VECTORS = {
    # Name in the record       system, port
    "points": ("propagator", "points"),
    "target_points": ("controller", "target_points"),
    "goal_error": ("controller", "goal_error"),
    "potential": ("controller", "potential"),
    "tau": ("controller", "tau"),
    "joint_velocities": ("supervisor", "velocity"),
    "phase": ("sequencer", "phase"),
    "detect_request": ("sequencer", "detect_request"),
    "tracker_status": ("tracker", "status"),
}


class Sample(NamedTuple):
    """The values of all signals, by name, at one time [s]."""

    time: float
    values: dict[str, np.ndarray]


class CheckedTrack(NamedTuple):
    """A released track, and the true (N, 3) positions of its points at the stamp [m, world]."""

    track: TrackedPoints
    truth: np.ndarray


class TrackingLosses(NamedTuple):
    """How often tracks were lost while the robot needed them: until it released the object.

    Attributes:
        losses: How often the tracker lost the object.
        duration: How long the object was lost, in all [s].
        searches: How often the part detector searched again, after which the tracker restarts.
    """

    losses: int = 0
    duration: float = 0.0
    searches: int = 0

    def clause(self) -> str:
        """Returns a clause for the run's result; empty if nothing was lost."""
        if not (self.losses or self.searches):
            return ""
        return (
            f"tracks were lost {_times(self.losses)}, for {self.duration:.1f} s in all, "
            f"and the part was searched for again {_times(self.searches)}"
        )

    def figures(self) -> dict[str, float]:
        """Returns the attributes by the names that they have in a run's figures."""
        return {
            "tracks_lost": self.losses,
            "tracks_lost_time_s": self.duration,
            "repeated_searches": self.searches,
        }


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


@dataclass
class RunRecorder:
    """Collects samples of a closed loop; a run calls `sample` between steps of the simulation.

    A sample is added as a whole or not at all. So a Unix signal that stops the run during a sample
    leaves a consistent record.

    Attributes:
        loop: The closed loop.
        query_points: (N, 3) positions of the tracked points at the start [m, world]. The points
            move with the object.
        truth: The true state of the object; None on hardware.
        samples: The samples, in order.
        tracks: The released tracks whose stamp is the time of a sample; empty on hardware.
    """

    loop: ClosedLoop
    query_points: np.ndarray
    truth: SimulatedTruth | None
    samples: list[Sample] = field(default_factory=list)
    tracks: list[CheckedTrack] = field(default_factory=list)
    _poses: dict[float, np.ndarray] = field(default_factory=dict)

    def sample(self, root: Context) -> None:
        """Takes one sample from the root context of the loop's diagram."""
        values = {
            name: np.array(self._evaluate(root, system, port))
            for name, (system, port) in _VECTORS.items()
        }
        self.samples.append(Sample(root.get_time(), values))
        if self.truth is None:
            return
        self._poses[root.get_time()] = self.truth.object_pose(root)
        self._sample_track(root)
        if self.phase >= Phase.RELEASE:
            self.truth.observe(root)

    @property
    def judge(self) -> HangingJudge | None:
        """Measures how long the object has hung; None on hardware."""
        return None if self.truth is None else self.truth.judge

    @property
    def times(self) -> list[float]:
        """The times of the samples [s]."""
        return [sample.time for sample in self.samples]

    @property
    def phase(self) -> Phase:
        """The phase at the last sample."""
        return Phase(int(self.samples[-1].values["phase"][0]))

    def fault(self, root: Context) -> Fault:
        """Returns the fault that the sequencer reports."""
        return Fault(int(self._evaluate(root, "sequencer", "fault")[0]))

    def phase_start(self, root: Context) -> float:
        """Returns when the current phase began [s]."""
        return float(self._evaluate(root, "sequencer", "phase_start")[0])

    def safety_fault(self, root: Context) -> SafetyFault:
        """Returns the fault that the supervisor reports."""
        return SafetyFault(int(self._evaluate(root, "supervisor", "fault")[0]))

    def signal(self, name: str) -> np.ndarray:
        """Returns the signal `name`: a row per sample, or a number per sample if it is a scalar."""
        rows = np.array([sample.values[name] for sample in self.samples])
        return rows[:, 0] if rows.shape[1] == 1 else rows

    def tracking_losses(self) -> TrackingLosses:
        """Returns how often tracks were lost before the object was released."""
        used = self.signal("phase") < Phase.RELEASE
        lost = used & (self.signal("tracker_status") == TrackerStatus.LOST)
        began = lost & ~np.r_[False, lost[:-1]]
        periods = np.diff(self.times, append=self.times[-1:])
        searches = self.signal("detect_request")[used]
        return TrackingLosses(
            losses=int(began.sum()),
            duration=float(periods[lost].sum()),
            searches=int(searches.max(initial=0.0)),
        )

    def tracking_errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the (S,) stamps of `tracks` [s], and the (S, N) errors of their points [m].

        The error of a point that was not observed is NaN.
        """
        errors = np.full((len(self.tracks), len(self.query_points)), np.nan)
        for row, (track, truth) in zip(errors, self.tracks, strict=True):
            distances = np.linalg.norm(track.positions - truth, axis=1)
            row[:] = np.where(track.confidence > 0.0, distances, np.nan)
        return np.array([checked.track.stamp for checked in self.tracks]), errors

    def _evaluate(self, root: Context, system: str, port: str) -> Any:
        part = getattr(self.loop, system)
        return part.GetOutputPort(port).Eval(part.GetMyContextFromRoot(root))

    def _sample_track(self, root: Context) -> None:
        track = self._evaluate(root, "tracker", "tracked_points")
        if self.tracks and track.stamp <= self.tracks[-1].track.stamp:
            return
        now = self._poses.get(track.stamp)
        if now is None:
            return
        start = self._poses[min(self._poses)]
        truth = transform_points(now @ inverse(start), self.query_points)
        self.tracks.append(CheckedTrack(track, truth))

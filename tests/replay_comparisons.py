"""Synthetic runs and their comparisons."""

from pathlib import Path

import numpy as np

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.comparison.run_comparison import compare_runs
from poil_drake.recording.comparison.tolerances import ReplayTolerances
from poil_drake.recording.run_log.recorded_run import LoggedTrack, PhaseStart, RecordedRun, Series
from poil_drake.reports.replay_summary import ReplaySummary

TOLERANCES = ReplayTolerances(
    joint_velocity=0.1,
    angular_velocity=0.1,
    linear_velocity=0.1,
    tracked_points=0.001,
    phase_start=0.01,
    point_phases=("wait",),
)


def make_run(*, speed: float = 0.5, shift: float = 0.0, last: str = "follow") -> RecordedRun:
    """Returns a run of two seconds whose joints move at `speed` from 1 s on."""
    times = np.linspace(0.0, 2.0, 65)
    commands = np.where(times >= 1.0, speed, 0.0)[:, None] * np.ones(7)
    tracks = [
        LoggedTrack(k / 8 + 0.2, TrackedPoints(shift + np.eye(3), np.ones(3), k / 8))
        for k in range(12)
    ]
    return RecordedRun(
        Path("run.mcap"),
        tuple("1234567"),
        joints=Series(times, np.zeros((65, 21))),
        commands=Series(times, commands),
        twist=Series(times, np.zeros((65, 6))),
        phases=[PhaseStart(0.0, "wait", ""), PhaseStart(1.0, last, "")],
        tracks=tracks,
    )


def make_summary(recorded: RecordedRun, replayed: RecordedRun, **fields: object) -> ReplaySummary:
    """Returns the summary of a replay that took a quarter of a second."""
    given = {"station": "hardware", "tracker": "rigid_flow", "changed": False} | fields
    comparison = compare_runs(recorded, replayed, TOLERANCES)
    return ReplaySummary(
        log="logs/run.mcap", comparison=comparison, replayed=2.0, wall=0.25, **given
    )

"""One page that shows how a replay differs from its run."""

from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.recording.comparison.run_comparison import RunComparison
from poil_drake.recording.comparison.tolerances import JOINT_VELOCITY, TRACKED_POINTS
from poil_drake.recording.run_log.recorded_run import RecordedRun, Series
from poil_drake.reports.replay_summary import ReplaySummary
from poil_drake.reports.run_summary import PhaseSpan
from poil_drake.reports.summary_panels import (
    COLORS,
    draw_phases,
    draw_verdict,
    joint_colors,
    label_joints,
    styled_figure,
)

_SIZE = (12.0, 7.2)  # [in]


def make_replay_picture(
    path: str | Path,
    *,
    summary: ReplaySummary,
    recorded: RecordedRun,
    replayed: RecordedRun,
    velocity_limits: np.ndarray,
) -> None:
    """Draws the picture of a replay.

    Args:
        path: The file. Its suffix is the format, e.g. `.png` or `.pdf`.
        summary: The outcome of the replay.
        recorded: The signals of the run.
        replayed: The signals of its replay.
        velocity_limits: (J,) velocity limits of the joints [rad/s].
    """
    comparison = summary.comparison
    phases = [PhaseSpan(name=n, start=s, end=e) for n, s, e in comparison.spans]
    with styled_figure(path, _SIZE) as figure:
        _draw_header(figure, summary)
        axes = figure.subplots(
            3,
            sharex=True,
            gridspec_kw={
                "left": 0.075,
                "right": 0.915,
                "top": 0.78,
                "bottom": 0.075,
                "hspace": 0.12,
                "height_ratios": (1.6, 1.0, 1.0),
            },
        )
        draw_phases(axes, phases, max(recorded.end, 1e-3))
        for one in axes:
            for phase in comparison.phases:
                one.axvline(phase.replayed, color=COLORS["muted"], linewidth=0.8, linestyle=":")
        _draw_velocities(axes[0], recorded, replayed, velocity_limits)
        _draw_velocity_difference(axes[1], comparison)
        _draw_track_distance(axes[2], comparison)
        axes[2].set_xlabel("time [s]; dotted: phases of the replay")


def _draw_header(figure: Any, summary: ReplaySummary) -> None:
    verdict = "SAME" if summary.same else "DIFFERENT"
    right = draw_verdict(figure, verdict, success=summary.same, left=0.025, top=0.965) + 0.02
    reason = f"replay of {Path(summary.log).name}: {summary.reason}"
    figure.text(right, 0.965, reason, fontsize=12, weight="bold", va="top", wrap=True)
    about = f"{summary.station} run, tracker {summary.tracker}"
    if summary.changed:
        about += ", with settings other than those of the run"
    about = "; ".join([about, *summary.notes])
    figure.text(0.025, 0.905, about, fontsize=9.5, color=COLORS["muted"], va="top", wrap=True)


def _draw_velocities(
    axes: Any, recorded: RecordedRun, replayed: RecordedRun, limits: np.ndarray
) -> None:
    """Draws joint velocities as shares of their limits: recorded solid, replayed dashed."""
    for joint, color in enumerate(joint_colors(len(limits))):
        before, after = recorded.commands, replayed.commands
        share = 100.0 / limits[joint]
        axes.plot(
            before.times,
            share * before.values[:, joint],
            color=color,
            linewidth=1.0,
            label=f"{joint + 1}",
        )
        axes.plot(
            after.times,
            share * after.values[:, joint],
            color="black",
            linewidth=0.7,
            linestyle=(joint, (2, 3)),
            label="replayed" if joint == len(limits) - 1 else None,
        )
    label_joints(axes)


def _draw_velocity_difference(axes: Any, comparison: RunComparison) -> None:
    shift = 1e3 * comparison.tolerances.shift
    _draw_difference(
        axes,
        comparison.judged[JOINT_VELOCITY],
        comparison.limits(JOINT_VELOCITY),
        unjudged=comparison.differences[JOINT_VELOCITY] if shift else None,
        color=COLORS["points"],
        label=f"judged: up to {shift:.0f} ms earlier or later" if shift else None,
    )
    axes.set_ylabel("their difference\n[rad/s]")


def _draw_track_distance(axes: Any, comparison: RunComparison) -> None:
    distances = comparison.differences[TRACKED_POINTS]
    _draw_difference(
        axes,
        Series(distances.times, 1e3 * distances.values),
        1e3 * comparison.limits(TRACKED_POINTS),
        color=COLORS["truth"],
        marker=".",
    )
    axes.set_ylabel("tracked points'\ndistance [mm]")


def _draw_difference(
    axes: Any, series: Series, limits: np.ndarray, *, unjudged: Series | None = None, **style: Any
) -> None:
    values, tolerance, plain = (
        np.where(np.isfinite(drawn), drawn, np.nan)
        for drawn in (series.values[:, 0], limits, (unjudged or series).values[:, 0])
    )
    if unjudged is not None:
        axes.plot(unjudged.times, plain, color=COLORS["muted"], linewidth=0.7, label="as it is")
    axes.plot(series.times, values, linewidth=1.0, **style)
    axes.plot(
        series.times,
        tolerance,
        color=COLORS["failure"],
        linewidth=1.0,
        linestyle="--",
        label="tolerance",
    )
    largest = np.nanmax(np.concatenate([values, plain, tolerance, [1e-9]]))
    axes.set_ylim(0.0, 1.15 * largest)
    axes.legend(loc="upper left")

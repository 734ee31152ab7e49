"""One page that shows how a replay differs from its run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.recording.comparison.tolerances import JOINT_VELOCITY, TRACKED_POINTS
from poil_drake.recording.run_log.recorded_run import RecordedRun
from poil_drake.recording.run_log.series import Series
from poil_drake.reports.replay_summary import ReplaySummary
from poil_drake.reports.run_summary import PhaseSpan
from poil_drake.reports.summary_panels import (
    COLORS,
    STYLE,
    draw_phase_bands,
    draw_phase_names,
)

_SIZE = (12.0, 7.2)  # [in]
_DPI = 150


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplayPictureData:
    """What the picture shows.

    Attributes:
        summary: What the replay came to.
        recorded: The run.
        replayed: Its replay.
        velocity_limits: (J,) limits of the joints' velocities [rad/s].
    """

    summary: ReplaySummary
    recorded: RecordedRun
    replayed: RecordedRun
    velocity_limits: np.ndarray


def make_replay_picture(path: str | Path, data: ReplayPictureData) -> Path:
    """Draws the picture and returns its path; the folder is made where needed.

    Args:
        path: Where it goes; the suffix is the format, e.g. `.png` or `.pdf`.
        data: What it shows.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    panels: Sequence[Callable[[Any, ReplayPictureData], None]] = (
        _draw_velocities,
        _draw_velocity_difference,
        _draw_track_distance,
    )
    phases = [PhaseSpan(name=n, start=s, end=e) for n, s, e in data.summary.comparison.spans]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=_SIZE)
        FigureCanvasAgg(figure)
        _draw_header(figure, data.summary)
        axes = figure.subplots(
            len(panels),
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
        for one, draw in zip(axes, panels, strict=True):
            one.set_xlim(0.0, max(data.recorded.end, 1e-3))
            draw_phase_bands(one, phases)
            for phase in data.summary.comparison.phases:
                one.axvline(phase.replayed, color=COLORS["muted"], linewidth=0.8, linestyle=":")
            draw(one, data)
        axes[-1].set_xlabel("time [s]; dotted: phases of the replay")
        draw_phase_names(axes[0], phases)
        figure.savefig(path, dpi=_DPI)
    return path


def _draw_header(figure: Any, summary: ReplaySummary) -> None:
    color = COLORS["success"] if summary.same else COLORS["failure"]
    title = figure.text(
        0.025,
        0.965,
        " SAME " if summary.same else " DIFFERENT ",
        fontsize=14,
        weight="bold",
        color="white",
        va="top",
        bbox={"facecolor": color, "edgecolor": "none", "boxstyle": "round,pad=0.25"},
    )
    figure.canvas.draw()
    right = title.get_window_extent().x1 / figure.bbox.width + 0.02
    reason = f"replay of {Path(summary.log).name}: {summary.reason}"
    figure.text(right, 0.965, reason, fontsize=12, weight="bold", va="top", wrap=True)
    about = f"{summary.station} run, tracker {summary.tracker}"
    if summary.changed:
        about += ", with other settings than it was run with"
    about = "; ".join([about, *summary.notes])
    figure.text(0.025, 0.905, about, fontsize=9.5, color=COLORS["muted"], va="top", wrap=True)


def _draw_velocities(axes: Any, data: ReplayPictureData) -> None:
    """Draws each joint's speed as a share of its limit: solid as recorded, dashed as replayed."""
    import matplotlib as mpl

    count = len(data.velocity_limits)
    colors = mpl.colormaps["turbo"](np.linspace(0.06, 0.94, count))
    recorded, replayed = (
        (run.commands.times, 100.0 * run.commands.values / data.velocity_limits)
        for run in (data.recorded, data.replayed)
    )
    for joint in range(count):
        axes.plot(
            recorded[0],
            recorded[1][:, joint],
            color=colors[joint],
            linewidth=1.0,
            label=f"{joint + 1}",
        )
        axes.plot(
            replayed[0],
            replayed[1][:, joint],
            color="black",
            linewidth=0.7,
            linestyle=(joint, (2, 3)),
            label="replayed" if joint == count - 1 else None,
        )
    axes.set_ylabel("joint velocity\n[% of limit]")
    axes.legend(
        title="joint",
        loc="center left",
        bbox_to_anchor=(1.005, 0.5),
        handlelength=1.2,
        labelspacing=0.15,
        borderaxespad=0.2,
        title_fontsize=8.0,
        fontsize=7.5,
    )


def _draw_velocity_difference(axes: Any, data: ReplayPictureData) -> None:
    comparison = data.summary.comparison
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


def _draw_track_distance(axes: Any, data: ReplayPictureData) -> None:
    comparison = data.summary.comparison
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

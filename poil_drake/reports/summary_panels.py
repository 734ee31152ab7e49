"""The panels of pictures of runs: signals over time, with the skill's phases behind them."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.reports.run_summary import PhaseSpan
from poil_drake.systems.logging.snapshot_recorder import Snapshot

COLORS = {
    # The hues of the live view: points, target, reference.
    "points": "#e8470c",
    "target": "#00a352",
    "reference": "#6d1fd1",
    "truth": "#b07d00",
    "success": "#1a7f37",
    "failure": "#c62828",
    "muted": "#5a5f66",
    "grid": "#d9dce1",
}

_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.edgecolor": "#7a7f87",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": False,
    "grid.color": COLORS["grid"],
    "grid.linewidth": 0.6,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.0,
    "legend.framealpha": 0.75,
    "legend.edgecolor": "none",
    "lines.linewidth": 1.4,
    "lines.solid_joinstyle": "round",
    "svg.fonttype": "none",
}

_BANDS = ("#f3f4f6", "#ffffff")
_SPECIAL_BANDS = {"follow": "#e3eefb", "fault": "#fde4e4", "done": "#e4f4e8"}
_DPI = 150


@dataclass(frozen=True, eq=False, kw_only=True)
class SummaryData:
    """The contents of a summary picture. Empty fields are not drawn.

    Attributes:
        title: Name of the run, e.g. "Hang a mug".
        success: Whether the task succeeded.
        reason: Why it succeeded or failed, in one clause.
        subtitle: One line of further figures.
        times: (T,) times of the samples of points, potential, tau and joint velocities [s].
        point_errors: (T, N) distance of each point from its target [m]; NaN where unknown.
        potential: (T,) D of POIL eq. 4 [m^2].
        tau: (T,) time of the reference's closest sample [s].
        reference_duration: The reference's last time [s]; NaN if unknown.
        joint_velocities: (T, J) commanded or measured joint velocities [rad/s].
        velocity_limits: (J,) velocity limits of the joints [rad/s].
        phases: The skill's phases.
        tracking_times: (S,) times [s] of the tracker's samples.
        tracking_errors: (S, N) distance of each tracked point from the truth [m].
        snapshots: Camera pictures in order of time.
    """

    title: str
    success: bool
    reason: str
    subtitle: str = ""
    times: np.ndarray
    point_errors: np.ndarray
    potential: np.ndarray
    tau: np.ndarray
    reference_duration: float = np.nan
    joint_velocities: np.ndarray
    velocity_limits: np.ndarray
    phases: Sequence[PhaseSpan] = ()
    tracking_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    tracking_errors: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    snapshots: Sequence[Snapshot] = ()


@contextmanager
def styled_figure(path: str | Path, size: tuple[float, float]) -> Iterator[Any]:
    """Yields a figure, and then writes it to a file, whose folder is created if needed.

    Args:
        path: The file. Its suffix is the format, e.g. `.png` or `.pdf`.
        size: Width and height [in].
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=size)
        yield figure
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=_DPI)


def draw_verdict(figure: Any, text: str, *, success: bool, left: float, top: float) -> float:
    """Draws a white text on a green box (red without success), and returns the text's right edge.

    The text's top left corner is at (`left`, `top`). All positions are in figure coordinates.
    """
    verdict = figure.text(
        left,
        top,
        f" {text} ",
        fontsize=14,
        weight="bold",
        color="white",
        va="top",
        bbox={
            "facecolor": COLORS["success" if success else "failure"],
            "edgecolor": "none",
            "boxstyle": "round,pad=0.25",
        },
    )
    return verdict.get_window_extent().x1 / figure.bbox.width


def draw_phases(panels: Sequence[Any], phases: Sequence[PhaseSpan], end: float) -> None:
    """Shades the phases behind panels from time 0 to `end`, and names them above the first one."""
    for axes in panels:
        axes.set_xlim(0.0, end)
        for index, phase in enumerate(phases):
            color = _SPECIAL_BANDS.get(phase.name.lower(), _BANDS[index % 2])
            axes.axvspan(phase.start, phase.end, color=color, linewidth=0, zorder=0)
            if index:
                axes.axvline(phase.start, color="#c3c7cd", linewidth=0.7, zorder=0.5)
    top = panels[0]
    inches = top.get_position().width * top.figure.get_figwidth()
    centres = np.array([(phase.start + phase.end) / 2.0 for phase in phases])
    places = spread_out(centres, gap=0.24 * end / inches, upper=end)
    for phase, centre, place in zip(phases, centres, places, strict=True):
        top.plot(
            [centre, place],
            [1.0, 1.08],
            color="#a5aab2",
            linewidth=0.7,
            transform=top.get_xaxis_transform(),
            clip_on=False,
        )
        top.text(
            place,
            1.10,
            phase.name.replace("_", " "),
            transform=top.get_xaxis_transform(),
            rotation=35,
            ha="left",
            va="bottom",
            rotation_mode="anchor",
            fontsize=8.5,
            color="#333840",
        )


def spread_out(places: np.ndarray, *, gap: float, upper: float) -> np.ndarray:
    """Returns ascending positions on an axis, moved apart to a minimum distance.

    Args:
        places: (P,) the positions.
        gap: The minimum distance.
        upper: Upper bound of the moved positions. A last position beyond it does not move.
    """
    moved = np.array(places, dtype=float)
    for i in range(1, len(moved)):
        moved[i] = max(moved[i], moved[i - 1] + gap)
    if len(moved):
        moved[-1] = max(min(moved[-1], upper), places[-1])
    for i in range(len(moved) - 2, -1, -1):
        moved[i] = min(moved[i], moved[i + 1] - gap)
    return moved


def draw_point_error(axes: Any, data: SummaryData) -> None:
    """Draws the mean point error and the range over the points, in mm."""
    _draw_errors(axes, data.times, data.point_errors, COLORS["points"])
    axes.set_ylabel("point error\n[mm]")


def draw_tracking_error(axes: Any, data: SummaryData) -> None:
    """Draws the mean distance of tracked from true points, and the range over the points, in mm."""
    _draw_errors(axes, data.tracking_times, data.tracking_errors, COLORS["truth"])
    axes.set_ylabel("tracking error\n[mm]")


def _draw_errors(axes: Any, times: np.ndarray, errors: np.ndarray, color: str) -> None:
    known = np.isfinite(errors).any(axis=1)
    errors_mm = np.where(known[:, None], errors, 0.0) * 1e3
    low, high, mean = (
        np.where(known, reduce(errors_mm, axis=1), np.nan)
        for reduce in (np.nanmin, np.nanmax, np.nanmean)
    )
    axes.fill_between(
        times, low, high, color=color, alpha=0.22, linewidth=0, label="range over the points"
    )
    axes.plot(times, mean, color=color, label="mean")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper right", ncols=2)
    _write_last(axes, mean, "last\n{:.1f} mm", color)


def draw_potential(axes: Any, data: SummaryData) -> None:
    """Draws the potential D on a logarithmic axis."""
    positive = np.where(data.potential > 0.0, data.potential, np.nan)
    axes.plot(data.times, positive, color=COLORS["reference"])
    axes.set(yscale="log", ylabel="potential $D$\n[m²]")
    _write_last(axes, positive, "last\n{:.1e} m²", COLORS["reference"])


def draw_progress(axes: Any, data: SummaryData) -> None:
    """Draws the time of the reference's closest sample, and the reference's duration."""
    axes.plot(data.times, data.tau, color=COLORS["target"])
    axes.set(ylabel="progress τ*\n[s]", ylim=(0.0, None))
    if np.isfinite(data.reference_duration):
        axes.axhline(data.reference_duration, color=COLORS["muted"], linewidth=0.9, linestyle="--")
        axes.set_ylim(top=1.12 * data.reference_duration)
        _write_last(axes, np.array([data.reference_duration]), "goal", COLORS["muted"])


def draw_joint_velocities(axes: Any, data: SummaryData) -> None:
    """Draws each joint's velocity as a share of its limit."""
    share = 100.0 * data.joint_velocities / data.velocity_limits
    for joint, color in enumerate(joint_colors(share.shape[1])):
        axes.plot(data.times, share[:, joint], color=color, linewidth=1.0, label=f"{joint + 1}")
    largest = np.nanmax(np.abs(share), initial=0.0)
    reach = min(max(1.25 * largest, 10.0), 110.0) if largest <= 100.0 else 1.1 * largest
    axes.set_ylim(-reach, reach)
    for limit in (-100.0, 100.0):
        axes.axhline(limit, color=COLORS["failure"], linewidth=1.0, linestyle="--")
    label_joints(axes)


def joint_colors(count: int) -> np.ndarray:
    """Returns one colour for each joint, (J, 4) RGBA."""
    import matplotlib as mpl

    return mpl.colormaps["turbo"](np.linspace(0.06, 0.94, count))


def label_joints(axes: Any) -> None:
    """Labels a panel of joint velocities, and adds a legend to its right."""
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


def _write_last(axes: Any, values: np.ndarray, text: str, color: str) -> None:
    """Writes the last finite value, formatted into `text`, to the right of the panel."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return
    axes.annotate(
        text.format(finite[-1]),
        xy=(1.0, finite[-1]),
        xycoords=("axes fraction", "data"),
        xytext=(5, 0),
        textcoords="offset points",
        va="center",
        fontsize=8.5,
        color=color,
        annotation_clip=False,
    )

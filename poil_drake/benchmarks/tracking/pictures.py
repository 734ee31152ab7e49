"""The pictures of the tracking benchmark: figures, and frames with the tracks."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.benchmarks.tracking.measures import WRONG
from poil_drake.benchmarks.tracking.trial import TrackedTrial
from poil_drake.reports.summary_panels import COLORS, styled_figure

_FLOOR = 0.1  # [mm], lower end of the axes of errors


def draw_figures(
    table: Mapping[tuple[str, bool, str], Mapping[str, float | int | str]], path: Path
) -> None:
    """Draws median and 95th percentile of the errors of each tracker in each case.

    Args:
        table: The figures of each tracker, with and without prior, in each case.
        path: The file (`.png`).
    """
    cases = list(dict.fromkeys(case for _, _, case in table))
    rows = list(dict.fromkeys((tracker, prior) for tracker, prior, _ in table))
    with styled_figure(path, (3.0 + 0.75 * len(cases), 4.5)) as figure:
        axes = figure.subplots()
        for index, (tracker, prior) in enumerate(rows):
            x = np.arange(len(cases)) + (index - (len(rows) - 1) / 2) * 0.8 / len(rows)
            cells = [table.get((tracker, prior, case), {}) for case in cases]
            median, high = (
                1e3 * np.array([float(c.get(name, np.nan)) for c in cells])
                for name in ("error_median", "error_p95")
            )
            name = f"{tracker}{'' if prior else ', no prior'}"
            bars = axes.bar(x, median, 0.7 / len(rows), label=name, bottom=_FLOOR)
            axes.vlines(x, median, high, color=bars.patches[0].get_facecolor(), linewidth=1.5)
        axes.axhline(1e3 * WRONG, color=COLORS["muted"], linewidth=0.8, linestyle=":")
        axes.set_yscale("log")
        axes.set_ylim(bottom=_FLOOR)
        axes.set_xticks(range(len(cases)), cases, rotation=30, ha="right")
        axes.set_ylabel("error [mm]: median, line to 95 %")
        axes.legend(loc="upper left", fontsize=8)
        figure.subplots_adjust(left=0.1, right=0.98, top=0.95, bottom=0.22)


def draw_tracks(trials: Sequence[TrackedTrial], path: Path) -> None:
    """Draws one case: frames of the first seed with the tracks, and every trial's error.

    Args:
        trials: The trials of the case. Without any that ran, nothing is written.
        path: The file (`.png`).
    """
    trials = [one for one in trials if one.track is not None]
    rows = list(dict.fromkeys((one.tracker, one.prior) for one in trials))
    if not rows:
        return
    with styled_figure(path, (14.0, 5.0 * len(rows))) as figure:
        axes = figure.subplots(
            2 * len(rows), 1, gridspec_kw={"height_ratios": [2.2, 1.0] * len(rows)}
        )
        for index, row in enumerate(rows):
            own = [one for one in trials if (one.tracker, one.prior) == row]
            name = f"{row[0]}{'' if row[1] else ', no prior'}: {own[0].case}"
            _draw_tiles(axes[2 * index], own, name)
            _draw_errors(axes[2 * index + 1], own)
        axes[-1].set_xlabel("time [s]; shaded: the disturbance; red: reported as lost")
        figure.subplots_adjust(left=0.06, right=0.98, top=0.97, bottom=0.5 / (5.0 * len(rows)))


def _draw_tiles(axes: Any, trials: Sequence[TrackedTrial], name: str) -> None:
    tiles = next((one.tiles for one in trials if one.tiles), ())
    if tiles:
        axes.imshow(np.concatenate(tiles, axis=1))
    axes.set_title(name, loc="left")
    axes.axis("off")


def _draw_errors(axes: Any, trials: Sequence[TrackedTrial]) -> None:
    for one in trials:
        if (track := one.track) is None:
            continue
        errors = 1e3 * track.mean_errors
        axes.plot(track.times, np.maximum(errors, _FLOOR), linewidth=0.9, color=COLORS["muted"])
        lost = track.times[track.lost]
        axes.plot(lost, np.full(len(lost), _FLOOR), "|", color="red", markersize=8)
        if track.disturbance is not None:
            start, end = track.disturbance
            axes.axvspan(start, max(end, start + 0.05), color="0.85", linewidth=0, alpha=0.4)
    axes.set_yscale("log")
    axes.set_ylim(_FLOOR, 300.0)
    axes.set_ylabel("error [mm]")

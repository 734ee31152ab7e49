"""Compares the theory of the field with simulation: saddles, sampling, delay and noise."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from poil_drake.benchmarks.stability.measures import (
    measure_delay,
    measure_escape,
    measure_noise,
    measure_sampling,
)
from poil_drake.recording.mcap.plain_json import write_json

_COLORS = ("#1f5fa8", "#c8501e", "#2f8f5b")
_GREY = "#6b7178"
_STYLE = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e5e8",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.dpi": 130,
}


def run_stability_study(*, pictures: Path, json_path: Path) -> dict[str, Any]:
    """Compares predictions with simulations, draws both, and writes all results as JSON.

    Args:
        pictures: Folder for `control_escape.png`, `control_sampling.png`, `control_delay.png` and
            `control_noise.png`.
        json_path: JSON file for the results.

    Returns:
        The results by study: "escape", "sampling", "delay" and "noise".
    """
    studies = {
        "escape": (measure_escape, _draw_escape, (7.4, 4.6)),
        "sampling": (measure_sampling, _draw_sampling, (13.5, 4.3)),
        "delay": (measure_delay, _draw_delay, (12.0, 4.8)),
        "noise": (measure_noise, _draw_noise, (7.4, 4.6)),
    }
    pictures.mkdir(parents=True, exist_ok=True)
    figures = {}
    for name, (measure, draw, size) in studies.items():
        figures[name] = measure()
        with mpl.rc_context(_STYLE):
            figure = Figure(figsize=size, layout="constrained")
            draw(figure, figures[name])
            figure.savefig(pictures / f"control_{name}.png")
    write_json(figures, json_path)
    return figures


def _draw_escape(figure: Figure, figures: Mapping[str, Any]) -> None:
    """Draws the results of `measure_escape`: times to leave the saddles against initial angles."""
    axes = figure.subplots()
    markers = ("o", "s", "^")
    for way in sorted(figures["ways"], key=lambda way: -way["predicted"][0]):
        color = _COLORS[way["saddle"] - 1]
        axes.plot(figures["distances"], way["predicted"], color=color, linewidth=1.2)
        axes.plot(
            figures["distances"],
            way["times"],
            markers[way["axis"] - 1],
            color=color,
            markersize=4 + 3 * (3 - way["saddle"]),
            markerfacecolor="none",
            label=f"saddle {way['saddle']} about axis {way['axis']}: rate {way['rate']:.2f}, "
            f"measured slope {way['slope']:.2f}",
        )
    axes.set_xscale("log")
    axes.invert_xaxis()
    axes.set(
        xlabel="angle from the saddle at the start [rad]",
        ylabel=f"η × time until {figures['end']:g} rad away",
    )
    moments = " : ".join(f"{m:g}" for m in figures["moments"])
    axes.set_title(f"Leaving the saddles: eigenvalues of W are {moments}", loc="left")
    axes.plot([], [], color=_GREY, linewidth=1.2, label="lines: closed form, slope 1 / rate")
    axes.legend(loc="upper left")
    axes.set_ylim(0.0, 1.35 * max(np.max(way["times"]) for way in figures["ways"]))


def _draw_sampling(figure: Figure, figures: Mapping[str, Any]) -> None:
    """Draws the results of `measure_sampling` in three panels: runs, rotations, point sets."""
    left, middle, right = figure.subplots(1, 3)
    _draw_runs(left, figures["runs"])
    _draw_rotations(middle, figures["sets"])
    _draw_conditions(right, figures)


def _draw_runs(axes: Any, runs: Mapping[str, Any]) -> None:
    shades = mpl.colormaps["viridis"](np.linspace(0.05, 0.85, len(runs)))
    for (gain, potentials), shade in zip(runs.items(), shades, strict=True):
        axes.semilogy(potentials, ".-", color=shade, linewidth=1.2, label=gain)
    axes.set(ylim=(1e-9, 5.0), xlabel="periods", ylabel="D / D at the start")
    axes.set_title("Runs of the compact set", loc="left")
    axes.legend(title="η dt", loc="lower right", ncols=2)


def _draw_rotations(axes: Any, sets: Mapping[str, Any]) -> None:
    for (name, data), color in zip(sets.items(), _COLORS, strict=False):
        moments = " : ".join(f"{m:g}" for m in data["moments"])
        axes.plot(
            np.degrees(data["angles"]),
            data["limits"],
            ".",
            markersize=2,
            alpha=0.5,
            color=color,
            label=f"{name}, W = {moments}",
        )
        for value, style in ((data["largest"], "-"), (data["proven"], "--")):
            axes.axhline(value, color=color, linestyle=style, linewidth=1.2)
    axes.plot([], [], "-", color=_GREY, label="largest for all (search)")
    axes.plot([], [], "--", color=_GREY, label="proven for all")
    axes.set(
        ylim=(1.2, 6.0), xlabel="angle from the goal [deg]", ylabel="largest η dt that lowers D"
    )
    axes.set_title("Random rotations", loc="left")
    axes.legend(loc="upper left", markerscale=4)


def _draw_conditions(axes: Any, figures: Mapping[str, Any]) -> None:
    conditions, curves = figures["conditions"], figures["curves"]
    for name, style, color, label in (
        ("flat", "o-", _COLORS[0], "flat sets"),
        ("round", "s-", _COLORS[1], "round rods"),
        ("flat_proven", "--", _COLORS[0], "proven, flat sets"),
    ):
        axes.semilogx(conditions, curves[name], style, markersize=4, color=color, label=label)
    axes.axhline(figures["worst"], color=_GREY, linewidth=1.0, linestyle=":")
    axes.text(conditions[0], figures["worst"] + 0.015, "π / 2", color=_GREY)
    axes.set(
        ylim=(1.2, 2.1), xlabel="condition number of A", ylabel="largest η dt for every rotation"
    )
    axes.set_title("From compact to a line", loc="left")
    axes.legend(loc="upper right")


def _draw_delay(figure: Figure, figures: Mapping[str, Any]) -> None:
    """Draws the results of `measure_delay`: the map over delay and period, and a run."""
    left, right = figure.subplots(1, 2, width_ratios=[1.15, 1.0])
    _draw_delay_map(left, figures)
    _draw_delayed_run(right, figures["tracker"])


def _draw_delay_map(axes: Any, figures: Mapping[str, Any]) -> None:
    axes.grid(False)
    axes.pcolormesh(
        figures["delays"],
        figures["periods"],
        figures["verdicts"],
        cmap=ListedColormap(["#cfe6d6", "#fbe7b8", "#f3c9bd"]),
        vmin=0,
        vmax=2,
        shading="nearest",
    )
    without_overshoot, stable = figures["continuous"]
    for name, at_zero, color, label in (
        ("limits_without_overshoot", without_overshoot, "#2f8f5b", "no overshoot: closed form"),
        ("limits_stable", stable, "#b03a1a", "stable: closed form"),
    ):
        limits = figures[name]
        x, y = np.append(figures["ratios"] * limits, at_zero), np.append(limits, 0.0)
        axes.plot(x, y, color=color, linewidth=1.6, label=label)
    tracker = figures["tracker"]
    axes.plot(
        tracker["eta_delay"], tracker["eta_period"], "k*", markersize=11, label="8 Hz, 0.1875 s"
    )
    axes.text(0.03, 0.1, "D falls", fontsize=9)
    axes.text(0.3, 0.72, "settles, but D rises at times", fontsize=9)
    axes.text(1.25, 1.3, "does not settle", fontsize=9)
    axes.set(
        xlim=(0.0, 1.8), ylim=(0.0, 2.2), xlabel="η × delay", ylabel="η × period of the samples"
    )
    axes.set_title("Simulated (areas) and closed form (lines)", loc="left")
    axes.legend(loc="upper right", facecolor="white", framealpha=0.85, frameon=True)


def _draw_delayed_run(axes: Any, tracker: Mapping[str, Any]) -> None:
    shown = 30
    offsets = tracker["offsets"][:shown]
    axes.plot(offsets, "o-", markersize=4, color=_COLORS[0], label="offset / its start")
    size = tracker["decay_per_period"] ** np.arange(shown)
    axes.plot(size, "--", color=_GREY, linewidth=1.0, label="rate of the largest root")
    axes.plot(-size, "--", color=_GREY, linewidth=1.0)
    axes.axhline(0.0, color=_GREY, linewidth=0.8)
    axes.set(xlabel="sample (1/8 s)", ylabel="offset of the centroid")
    axes.set_title("η = 3 / s on points 0.1875 s old, without propagation", loc="left")
    axes.legend(loc="upper right")


def _draw_noise(figure: Figure, figures: Mapping[str, Any]) -> None:
    """Draws the results of `measure_noise`: noise against the condition number of the points."""
    axes = figure.subplots()
    condition = figures["condition"]
    noise, floor = 1e3 * figures["point_noise"], 1e3 * figures["min_rotation_spread"]
    for predicted, measured, color, marker, size, label in (
        ("predicted", "measured", _COLORS[1], "o", 8, "least squares"),
        ("predicted_limited", "limited", _COLORS[0], "s", 4, f"slowed below {floor:g} mm"),
    ):
        axes.loglog(condition, np.degrees(figures[predicted]), color=color, linewidth=1.2)
        axes.loglog(
            condition,
            np.degrees(figures[measured]),
            marker,
            color=color,
            markersize=size,
            markerfacecolor="none",
            label=f"about the line: {label}",
        )
    axes.loglog(
        condition, np.degrees(figures["across"]), color=_COLORS[2], label="about the other axes"
    )
    axes.plot([], [], color=_GREY, label="lines: to first order in the noise")
    axes.set(xlabel="condition number of A", ylabel="standard deviation of ω / η [deg]")
    axes.set_title(f"8 points along 10 cm, {noise:g} mm of noise", loc="left")
    axes.legend(loc="upper left")

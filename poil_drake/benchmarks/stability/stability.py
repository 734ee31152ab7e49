"""Draws the theory of the field beside simulation: saddles, sampling, delay and noise."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from poil_drake.benchmarks.stability.delay import measure_delay
from poil_drake.benchmarks.stability.measures import (
    measure_escape,
    measure_noise,
    measure_sampling,
)
from poil_drake.benchmarks.stability.pictures import (
    draw_delay,
    draw_escape,
    draw_noise,
    draw_sampling,
)
from poil_drake.recording.mcap.plain_json import write_json


def run_stability_study(*, pictures: Path, json_path: Path) -> dict[str, Any]:
    """Simulates what the theory predicts, draws both, and writes all figures as JSON.

    Args:
        pictures: Folder for `control_escape.png`, `control_sampling.png`, `control_delay.png` and
            `control_noise.png`.
        json_path: File for the figures.

    Returns:
        The figures by study: "escape", "sampling", "delay" and "noise".
    """
    studies: dict[str, tuple[Callable[..., dict[str, Any]], Callable[..., None]]] = {
        "escape": (measure_escape, draw_escape),
        "sampling": (measure_sampling, draw_sampling),
        "delay": (measure_delay, draw_delay),
        "noise": (measure_noise, draw_noise),
    }
    pictures.mkdir(parents=True, exist_ok=True)
    figures = {}
    for name, (measure, draw) in studies.items():
        figures[name] = measure()
        draw(figures[name], pictures / f"control_{name}.png")
    write_json(figures, json_path)
    return figures

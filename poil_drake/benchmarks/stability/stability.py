"""Compares the theory of the field with simulation: saddles, sampling, delay and noise."""

from pathlib import Path
from typing import Any

from poil_drake.benchmarks.stability import delay, drawing, measures
from poil_drake.recording.mcap.plain_json import write_json


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
        "escape": (measures.measure_escape, drawing.draw_escape),
        "sampling": (measures.measure_sampling, drawing.draw_sampling),
        "delay": (delay.measure_delay, drawing.draw_delay),
        "noise": (measures.measure_noise, drawing.draw_noise),
    }
    pictures.mkdir(parents=True, exist_ok=True)
    figures = {}
    for name, (measure, draw) in studies.items():
        figures[name] = measure()
        draw(figures[name], pictures / f"control_{name}.png")
    write_json(figures, json_path)
    return figures

"""Writes the figures of the control study as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.benchmarks.control.arena.arena import ArenaConfig
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.policies.policies import LEARNED
from poil_drake.benchmarks.control.study_config import ControlStudyConfig
from poil_drake.benchmarks.control.table import summarize
from poil_drake.benchmarks.control.trial import ControlTrial, TrialConfig
from poil_drake.recording.mcap.library_versions import library_versions
from poil_drake.recording.mcap.plain_json import write_json


def write_figures(
    trials: Sequence[ControlTrial],
    config: ControlStudyConfig,
    path: Path,
    *,
    hard: Mapping[str, Any] | None = None,
) -> None:
    """Writes everything that is known of the trials; the file appears whole.

    Args:
        trials: Those that have ended.
        config: What was to be tried.
        path: Where to.
        hard: What makes hard mode hard; None without it.
    """
    figures = {
        "config": asdict(config),
        "arena": asdict(ArenaConfig()),
        "trial": asdict(TrialConfig()),
        "hard": hard,
        "policies": {name: asdict(LEARNED[name]) for name in config.policies if name in LEARNED},
        "libraries": library_versions(),
        "paper": {task: MakeTask(task).paper for task in config.tasks},
        "summary": [vars(cell) for cell in summarize(trials)],
        "trials": [_row(trial) for trial in trials],
    }
    write_json(figures, path, indent=None)


def _row(trial: ControlTrial) -> dict[str, object]:
    """Returns a trial's figures, its path in whole millimetres."""
    return {**vars(trial), "path": np.round(1e3 * trial.path).astype(int).tolist()}

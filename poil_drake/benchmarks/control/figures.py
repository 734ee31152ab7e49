"""Writes the figures of the control study as JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from poil_drake.benchmarks.control.arena.arena import ArenaConfig
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.policies.policies import LEARNED
from poil_drake.benchmarks.control.study_config import HARD, ControlStudyConfig
from poil_drake.benchmarks.control.table import summarize
from poil_drake.benchmarks.control.trial import ControlTrial, TrialConfig
from poil_drake.recording.mcap.library_versions import library_versions
from poil_drake.recording.mcap.plain_json import write_json


def write_figures(trials: Sequence[ControlTrial], config: ControlStudyConfig, path: Path) -> None:
    """Writes all figures of the trials that have ended, with all settings of the study."""
    figures = {
        "config": asdict(config),
        "arena": asdict(ArenaConfig()),
        "trial": asdict(TrialConfig()),
        "hard": asdict(HARD) if config.hard else None,
        "policies": {name: asdict(LEARNED[name]) for name in config.policies if name in LEARNED},
        "libraries": library_versions(),
        "paper": {task: MakeTask(task).paper for task in config.tasks},
        "summary": [vars(cell) for cell in summarize(trials)],
        # Paths in whole millimetres.
        "trials": [
            {**vars(trial), "path": np.round(1e3 * trial.path).astype(int)} for trial in trials
        ],
    }
    write_json(figures, path, indent=None)

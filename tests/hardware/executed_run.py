"""Runs the hardware loop as the command line does: `executed_run.py SCENARIO.yaml FOLDER`."""

import signal
import sys
from pathlib import Path

from hardware_bench import swinging_plan

from poil_drake.cli import Stopped, _stop
from poil_drake.diagrams.run import skill_run
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.skill_run import ExecutePlan
from poil_drake.diagrams.scenario.load import LoadScenario
from poil_drake.runtime.held_signals import ENDING


def main(scenario: Path, folder: Path) -> int:
    # Its dry run would slow down a run beside this one.
    skill_run.pace_warning = lambda plan, scenario: None
    for number in ENDING:
        signal.signal(number, _stop)
    try:
        summary = ExecutePlan(
            swinging_plan(),
            LoadScenario(filename=scenario),
            outputs=OutputPaths(mcap=folder / "run.mcap", json=folder / "run.json"),
            hardware=True,
            show=False,
            show_progress=False,
            check=False,
        )
    except Stopped as stop:
        return 128 + stop.number
    return 0 if summary.success else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))

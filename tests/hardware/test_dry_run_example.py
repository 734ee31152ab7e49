"""The example of a dry run on hardware, with `poil driver` as the robot."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from hardware_bench import hardware_scenario

from poil_drake.diagrams.scenario.load import DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario

pytestmark = [pytest.mark.render, pytest.mark.real_time]

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "hardware_dry_run.py"
assert EXAMPLE.name == "hardware_dry_run.py"


def test_a_dry_run_goes_through_the_whole_skill(
    scenario: Scenario, plan_file: Path, time_scale: float, tmp_path: Path
) -> None:
    file = tmp_path / "scenario.yaml"
    # The driver renders beside the loop: half the pace that the loop alone keeps.
    file.write_text(DumpScenario(hardware_scenario(scenario, time_scale=time_scale / 2, speed=1.0)))

    done = subprocess.run(
        [sys.executable, EXAMPLE, plan_file, tmp_path / "out", file],
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "out" / "run.json").read_text())
    assert [phase["name"] for phase in figures["phases"]][:3] == ["wait", "approach", "descend"]

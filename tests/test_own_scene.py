"""The scenario in docs/your_own_scene.md."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from poil_drake.diagrams.demonstration.recorder import RecordDemonstration
from poil_drake.diagrams.scenario.load import LoadScenario

PAGE = Path(__file__).parents[1] / "docs" / "your_own_scene.md"


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    found = re.search(r"```yaml\n(MyCell:.*?)```", PAGE.read_text(), flags=re.DOTALL)
    assert found is not None
    file = tmp_path / "my_cell.yaml"
    file.write_text(found[1])
    return file


@pytest.mark.render
def test_its_demonstration_is_recorded(scenario: Path, tmp_path: Path) -> None:
    rarely = LoadScenario(
        data="{poil: {rates: {tracker: 1}}}", defaults=LoadScenario(filename=scenario)
    )

    assert RecordDemonstration(rarely, tmp_path / "demo.mcap") == 8


@pytest.mark.slow
@pytest.mark.render
def test_a_raised_and_turned_cell_with_small_cameras_hangs_the_mug(scenario: Path) -> None:
    program = Path(sys.executable).with_name("poil")
    done = subprocess.run(
        [program, "run", str(scenario), "--no-meshcat", "--json", "run.json"],
        cwd=scenario.parent,
        capture_output=True,
        text=True,
    )

    assert done.returncode == 0, done.stderr + done.stdout
    run = json.loads((scenario.parent / "run.json").read_text())
    assert run["losses"] == ""
    assert run["figures"]["tracks_lost"] == run["figures"]["repeated_searches"] == 0
    assert run["tracking_error"]["median"] < 0.0015

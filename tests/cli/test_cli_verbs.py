"""The verbs of the command line, from a demonstration to a mug that hangs, in a user's folder."""

import json
from pathlib import Path

import cv2
import pytest
from command_line import Command

pytestmark = [pytest.mark.slow, pytest.mark.render]


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_a_demonstration_is_drawn(command: Command, tmp_path: Path, demonstration: Path) -> None:
    (tmp_path / "mine.mcap").write_bytes(demonstration.read_bytes())

    dut = command("demo", "show", "mine.mcap")

    assert (dut.status, dut.out) == (0, "drew out/mine.png\n")
    assert files(tmp_path) == {"mine.mcap", "out/mine.png"}
    assert cv2.imread("out/mine.png").std() > 10.0


def test_a_plan_is_executed(command: Command, tmp_path: Path, plan_file: Path) -> None:
    dut = command("execute", str(plan_file), "--tracker", "ground_truth", "--no-meshcat")

    assert dut.status == 0
    assert dut.out.splitlines()[-1].startswith("SUCCESS: the mug hangs on the rack")
    assert files(tmp_path) == {"out/run.json", "out/run.mcap", "out/run.png"}
    assert all(name in dut.out for name in files(tmp_path))
    figures = json.loads(Path("out/run.json").read_text())
    assert figures["success"] is True
    assert figures["tracker"] == "ground_truth"
    assert figures["tracking_error"]["maximum"] < 1e-9


def test_the_doctor_finds_nothing_missing(command: Command) -> None:
    dut = command("doctor")

    lines = dut.out.splitlines()
    # LCM's own messages may need longer than the doctor waits for them.
    wrong = [line for line in lines if not line.startswith("ok") and "lcm" not in line]
    assert dut.status == 0 or not wrong, lines
    assert any(line.startswith("ok") and "drake" in line.lower() for line in lines)

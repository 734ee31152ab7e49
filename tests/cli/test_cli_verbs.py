"""The verbs of the command line, from a demonstration to a mug that hangs, in a user's folder."""

import json
from pathlib import Path

import cv2
import pytest
from test_cli import run

pytestmark = [pytest.mark.slow, pytest.mark.render]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, demonstration: Path) -> Path:
    """Where the commands run: a folder with nothing but a demonstration."""
    (tmp_path / "mine.mcap").write_bytes(demonstration.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_a_demonstration_is_drawn(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, ["demo", "show", "mine.mcap"]) == 0

    assert capsys.readouterr().out == "drew out/mine.png\n"
    assert files(folder) == {"mine.mcap", "out/mine.png"}
    assert cv2.imread("out/mine.png").std() > 10.0


def test_a_plan_is_executed(
    folder: Path,
    plan_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    truth = ["--tracker", "ground_truth", "--no-meshcat"]
    assert run(monkeypatch, ["execute", str(plan_file), *truth]) == 0

    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("SUCCESS: the mug hangs on the rack")
    assert files(folder) == {
        "mine.mcap",
        "out/run.json",
        "out/run.mcap",
        "out/run.png",
    }
    figures = json.loads(Path("out/run.json").read_text())
    assert figures["success"] is True
    assert figures["tracker"] == "ground_truth"
    assert figures["tracking_error"]["maximum"] < 1e-9


def test_the_doctor_finds_what_the_tests_run_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    status = run(monkeypatch, ["doctor"])

    lines = capsys.readouterr().out.splitlines()
    # LCM's own messages may need longer than it waits for them.
    wrong = [line for line in lines if not line.startswith("ok") and "lcm" not in line]
    assert status == 0 or not wrong, lines
    assert any(line.startswith("ok") and "drake" in line.lower() for line in lines)

import json
import os
from pathlib import Path

import pytest
from short_skill import short_scenario

from poil_drake.diagrams.run.output_paths import FreshOutputs, OutputPaths, failure_reason
from poil_drake.errors import NoFeasibleGraspError
from poil_drake.runtime.output_files import OutputError
from poil_drake.runtime.stopwatch import Stopwatch


def test_unlink_removes_the_outputs_only(tmp_path: Path) -> None:
    dut = OutputPaths.under(tmp_path)
    dut.json.touch()
    (tmp_path / "other.json").touch()

    dut.unlink()

    assert [path.name for path in tmp_path.iterdir()] == ["other.json"]


def test_check_leaves_the_outputs_alone(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")

    OutputPaths.under(tmp_path).check()

    assert (tmp_path / "run.json").exists()


@pytest.mark.parametrize(
    ("names", "says"),
    [
        ({"html": "folder"}, "folder' is a folder"),
        ({"png": "folder.png"}, "folder.png' is a folder"),
        ({"json": "folder"}, "folder' is a folder"),
        ({"html": "run.txt", "json": "run.txt"}, "'html' and 'json' both go to"),
        ({"png": "run.gif"}, r"\.png, \.pdf, \.svg"),
        ({"png": "run"}, r"\.png, \.pdf, \.svg"),
    ],
)
def test_check_rejects_unsuitable_outputs(names: dict[str, str], says: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.png").mkdir()

    with pytest.raises(OutputError, match=says):
        OutputPaths(**{kind: tmp_path / name for kind, name in names.items()}).check()


def test_unlink_removes_regular_files_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    removed: list[Path] = []
    monkeypatch.setattr(Path, "unlink", lambda path, missing_ok: removed.append(path))

    OutputPaths(json=pipe, mcap=Path("/dev/stdout"), png=Path("/dev/null")).unlink()

    assert removed == []


def test_the_usual_outputs_are_in_one_folder_except_those_given() -> None:
    dut = OutputPaths.under(Path("out"), name="trial", mcap=Path("logs/a.mcap"), png=None)

    assert dut == OutputPaths(
        html=Path("out/trial.html"),
        mcap=Path("logs/a.mcap"),
        png=Path("out/trial.png"),
        json=Path("out/trial.json"),
    )


def test_a_failed_job_leaves_its_figures_and_no_old_outputs(tmp_path: Path) -> None:
    outputs = OutputPaths.under(tmp_path)
    for path in vars(outputs).values():
        path.write_text("of an earlier run")
    stages = Stopwatch()
    error = NoFeasibleGraspError("No grasp is feasible.", remedy="Move the mug.")

    with (
        pytest.raises(NoFeasibleGraspError),
        FreshOutputs(outputs, short_scenario(), stages),
        stages.measure("planning"),
    ):
        raise error

    assert list(tmp_path.iterdir()) == [outputs.json]
    figures = json.loads(outputs.json.read_text())
    assert (figures["success"], figures["reason"]) == (False, "No grasp is feasible")
    assert (figures["scenario"], figures["seed"]) == ("HangMug", 0)
    assert figures["timing"]["stages"].keys() == {"planning"}
    assert figures["outputs"] == {"json": str(outputs.json)}


def test_figures_written_before_a_failure_are_kept(tmp_path: Path) -> None:
    outputs = OutputPaths(json=tmp_path / "run.json")

    def job() -> None:
        with FreshOutputs(outputs, short_scenario(), Stopwatch()):
            outputs.json.write_text("{}")
            raise OSError("the disk is full")

    with pytest.raises(OSError, match="full"):
        job()
    assert outputs.json.read_text() == "{}"


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (NoFeasibleGraspError("No grasp is feasible.", remedy="Move it."), "No grasp is feasible"),
        (KeyboardInterrupt(), "stopped by the user"),
        (KeyboardInterrupt("terminated"), "terminated"),
        (RuntimeError(), "RuntimeError"),
    ],
)
def test_a_reason_is_one_clause(error: BaseException, reason: str) -> None:
    assert failure_reason(error) == reason

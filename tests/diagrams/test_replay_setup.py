"""What a log must hold to be replayed, and what a user may ask for."""

import dataclasses
from pathlib import Path

import pytest
from mcap.records import Message
from recorded_runs import record, rewritten
from short_skill import short_plan, short_scenario

from poil_drake.diagrams.open_run_log import OpenRunLog
from poil_drake.diagrams.replay_setup import RECORDED, SetUpReplay
from poil_drake.diagrams.scenario_choice import ChooseScenario
from poil_drake.errors import PoilError, RunLogError
from poil_drake.recording.run_log import RunLogWriter


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    return record(path, short_scenario(), short_plan(), 0.125)


def test_a_log_says_what_was_run(log: Path) -> None:
    dut = SetUpReplay(log)

    assert dut.scenario.poil == short_scenario().poil
    assert dut.scenario.source.name == "HangMug"
    assert dut.plan.object_label == "mug"
    assert (dut.station, dut.tracker, dut.changed, dut.notes) == ("simulated", RECORDED, False, ())


def test_settings_are_laid_over_those_of_the_run(log: Path) -> None:
    dut = SetUpReplay(log, scenario_text="{poil: {eta: 1.5}}")

    assert dut.scenario.poil.eta == 1.5
    assert dut.scenario.poil.object == short_scenario().poil.object
    assert dut.changed


@pytest.mark.parametrize(
    ("name", "said"),
    [("scenario.yaml", "holds no scenario"), ("plan.npz", "holds no plan")],
)
def test_an_attachment_that_is_missing_is_named(
    log: Path, tmp_path: Path, name: str, said: str
) -> None:
    older = rewritten(log, tmp_path / "older.mcap", attachment=lambda a: a.name != name)

    with pytest.raises(RunLogError, match=f"{said}.*An older version wrote it"):
        SetUpReplay(older)


def test_a_log_without_joints_is_refused(tmp_path: Path) -> None:
    with OpenRunLog(tmp_path / "run.mcap", plan=short_plan(), scenario=short_scenario()):
        pass

    with pytest.raises(RunLogError, match="holds no joint states"):
        SetUpReplay(tmp_path / "run.mcap")


def test_a_log_that_was_cut_off_too_early_says_so(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[:5000])

    with pytest.raises(RunLogError, match=r"holds no .*is cut off"):
        SetUpReplay(cut)


@pytest.mark.parametrize(
    ("scenario_text", "plan", "said"),
    [
        ("A: {poil: {etta: 2}}", None, "The scenario in the log.*etta"),
        ("A: [", None, "The scenario in the log.*not valid YAML"),
        (None, b"PK no plan", "plan.npz' cannot be read"),
    ],
)
def test_damaged_attachments_are_named(
    tmp_path: Path, scenario_text: str | None, plan: bytes | None, said: str
) -> None:
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, scenario_text=scenario_text or "A: {}", plan=plan or b"") as log:
        log.write_joint_states([f"panda_joint{i}" for i in range(1, 8)], time=0.0)

    with pytest.raises(RunLogError, match=said) as caught:
        SetUpReplay(path)

    assert str(tmp_path / "scenario.yaml") not in str(caught.value)


@pytest.mark.parametrize(
    ("tracker", "text", "said"),
    [
        ("magic", None, "no point tracker 'magic'"),
        ("rigid_flow", None, "no images of the camera 'left'"),
        (None, "{poil: {etta: 2}}", "etta"),
        ("rigid_flow", "{poil: {detector: magic}}", "no part detector 'magic'"),
    ],
)
def test_what_cannot_be_replayed_is_refused(
    log: Path, tmp_path: Path, tracker: str | None, text: str | None, said: str
) -> None:
    seen = dataclasses.replace(short_scenario(), cameras=ChooseScenario().cameras)
    path = tmp_path / "run.mcap"
    with OpenRunLog(path, plan=short_plan(), scenario=seen) as writer:
        writer.write_joint_states([f"panda_joint{i}" for i in range(1, 8)], time=0.0)

    with pytest.raises(PoilError, match=said):
        SetUpReplay(path, tracker=tracker, scenario_text=text)


def test_the_truth_is_not_in_a_log_of_images(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with OpenRunLog(path, plan=short_plan(), scenario=ChooseScenario()) as writer:
        writer.write_joint_states([f"panda_joint{i}" for i in range(1, 8)], time=0.0)

    with pytest.raises(RunLogError, match="does not hold the truth"):
        SetUpReplay(path, tracker="ground_truth")
    assert SetUpReplay(path, tracker=RECORDED).tracker == RECORDED


def test_what_a_log_lacks_is_noted(log: Path, tmp_path: Path) -> None:
    def seldom(topic: str, message: Message) -> bytes | None:
        sparse = topic == "/robot/joint_states" and message.log_time % 31_250_000
        return None if sparse else message.data

    def spoil(values: dict[str, str]) -> dict[str, str]:
        return values | {"dropped_messages": "12", "drake_version": "0.1"}

    spoilt = rewritten(log, tmp_path / "spoilt.mcap", message=seldom, metadata=spoil)
    notes = "; ".join(SetUpReplay(spoilt).notes)

    assert "logged every 0.03125 s only" in notes
    assert "lacks 12 messages" in notes
    assert "written with drake 0.1" in notes

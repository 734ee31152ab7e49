"""What a log must contain for a replay, and which settings a user may choose."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from mcap.records import Message
from recorded_runs import moving_plan, record, rewritten, write_samples
from short_skill import short_plan, short_scenario

from poil_drake.diagrams.replay.contents import NotesOn
from poil_drake.diagrams.replay.setup import RECORDED, SetUpReplay
from poil_drake.diagrams.run.open_run_log import OpenRunLog
from poil_drake.diagrams.scenario.load import ChooseScenario, DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import PoilError, RunLogError, ScenarioError
from poil_drake.perception.images import CameraModel
from poil_drake.recording.comparison.tolerances import (
    CONTROL_TOLERANCES,
    PERCEPTION_TOLERANCES,
    ReplayTolerances,
)
from poil_drake.recording.run_log.reader import load_recorded_run
from poil_drake.recording.run_log.writer import RunLogWriter


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    return record(path, short_scenario(), short_plan(), 0.125)


def with_samples(folder: Path, scenario: Scenario, times: Sequence[float] = (0.0,)) -> Path:
    """Writes the log of a run in which the arm stood still."""
    with OpenRunLog(folder / "run.mcap", plan=short_plan(), scenario=scenario) as log:
        write_samples(log, times)
    return folder / "run.mcap"


def test_a_log_contains_what_was_run(log: Path) -> None:
    dut = SetUpReplay(log)

    assert dut.scenario.poil == short_scenario().poil
    assert dut.scenario.source.name == "HangMug"
    np.testing.assert_array_equal(dut.plan.target_points, short_plan().target_points)
    metadata = dut.run.metadata
    assert metadata["scenario"] == "HangMug"
    assert metadata["scenario_file"].endswith("hang_mug.yaml")
    assert {"poil_drake_version", "drake_version", "numpy_version"} <= metadata.keys()
    assert (dut.station, dut.tracker, dut.changed, dut.notes) == ("simulated", RECORDED, False, ())


@pytest.mark.parametrize(
    ("name", "said"),
    [("scenario.yaml", "holds no scenario"), ("plan.npz", "holds no plan")],
)
def test_an_attachment_that_is_missing_is_named(
    log: Path, tmp_path: Path, name: str, said: str
) -> None:
    older = rewritten(log, tmp_path / "older.mcap", attachment=lambda a: a.name != name)

    with pytest.raises(RunLogError, match=f"{said}.*may come from an older version"):
        SetUpReplay(older)


def test_settings_that_this_version_lacks_are_noted(log: Path, tmp_path: Path) -> None:
    with_more = tmp_path / "run.mcap"
    scenario = DumpScenario(short_scenario()).replace(
        "  poil:\n", "  poil:\n    temper: {heat: 3}\n"
    )
    run = load_recorded_run(log)
    with RunLogWriter(with_more, scenario_text=scenario, plan=run.plan or b"") as writer:
        write_samples(writer)

    dut = SetUpReplay(with_more)

    assert dut.scenario.poil == short_scenario().poil
    assert dut.notes[-1] == "settings that this version lacks were ignored: poil.temper"


def test_a_log_without_joints_is_refused(tmp_path: Path) -> None:
    path = with_samples(tmp_path, short_scenario(), times=())

    with pytest.raises(RunLogError, match="holds no joint states"):
        SetUpReplay(path)


def test_a_log_that_was_cut_off_too_early_is_reported(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[:5000])

    with pytest.raises(RunLogError, match=r"holds no .*is cut off"):
        SetUpReplay(cut)


@pytest.mark.parametrize(
    ("scenario_text", "plan", "said"),
    [
        ("A: {poil: {eta: two}}", None, "The scenario in the log.*poil.eta"),
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
def test_unsuitable_settings_are_refused(
    tmp_path: Path, tracker: str | None, text: str | None, said: str
) -> None:
    path = with_samples(tmp_path, ChooseScenario(tracker="ground_truth"))

    with pytest.raises(PoilError, match=said):
        SetUpReplay(path, tracker=tracker, scenario_text=text)


def test_the_ground_truth_needs_simulated_poses(tmp_path: Path) -> None:
    path = with_samples(tmp_path, ChooseScenario())

    with pytest.raises(RunLogError, match="needs simulated poses"):
        SetUpReplay(path, tracker="ground_truth")
    assert SetUpReplay(path, tracker=RECORDED).tracker == RECORDED


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of a run whose points were found, and whose arm moved."""
    path = tmp_path_factory.mktemp("run") / "moving.mcap"
    return record(path, short_scenario(), moving_plan(), 1.0)


def without(source: Path, target: Path, topic: str, joints: str | None = None) -> Path:
    """Copies a log without a topic, or without a field of its joint states."""

    def change(found: str, message: Message) -> bytes | None:
        if found != topic:
            return message.data
        if joints is None:
            return None
        states = JointStates.FromString(message.data)
        for joint in states.joints:
            joint.ClearField(joints)
        return states.SerializeToString()

    return rewritten(source, target, message=change)


@pytest.mark.parametrize(
    ("topic", "joints", "said"),
    [
        ("/robot/joint_states", None, "no joint states"),
        ("/robot/joint_commands", None, "no commanded joint velocities"),
        ("/robot/joint_commands", "position", "no commanded joint positions"),
        ("/robot/status", None, "no robot modes"),
        ("/hand/status", None, "no hand openings"),
        ("/points/tracked", None, "no tracks"),
        ("/tracker/times", None, "no capture times"),
    ],
)
def test_a_missing_topic_is_reported(
    moving: Path, tmp_path: Path, topic: str, joints: str | None, said: str
) -> None:
    lacking = without(moving, tmp_path / "lacking.mcap", topic, joints)

    with pytest.raises(RunLogError, match=f"holds {said}.* on the topic {topic}") as caught:
        SetUpReplay(lacking)

    assert "written by this version of poil run or poil execute" in caught.value.remedy


def test_a_topic_that_was_not_used_may_be_missing(log: Path, tmp_path: Path) -> None:
    # The arm stood still.
    lacking = without(log, tmp_path / "lacking.mcap", "/robot/joint_commands", "position")

    assert SetUpReplay(lacking).notes == ()


def with_images(path: Path, *, station: str, tracked: bool = True) -> Path:
    """Writes a log with an image of each camera and, if `tracked`, the track of the object."""
    camera = CameraModel("left", 640, 480, np.diag([500.0, 500.0, 1.0]), np.eye(4))
    with OpenRunLog(path, plan=short_plan(), scenario=ChooseScenario(), station=station) as log:
        write_samples(log)
        for name in ("left", "right"):
            log.write_image(name, np.zeros((480, 640, 3), np.uint8), time=0.0)
            log.write_depth(name, np.ones((480, 640), np.float32), time=0.0)
        log.write_calibration(camera, time=0.0)
        if tracked:
            log.write_points("tracked", np.eye(3), time=0.0, confidence=np.ones(3), exact=True)
            log.write_status("/tracker/times", {"begun": 0.0}, time=0.0)
    return path


def test_detector_times_are_needed_only_to_detect_again(tmp_path: Path) -> None:
    path = with_images(tmp_path / "run.mcap", station="hardware")

    with pytest.raises(RunLogError, match="on the topic /detector/times") as caught:
        SetUpReplay(path)

    assert "--tracker recorded" in caught.value.remedy
    assert SetUpReplay(path, tracker=RECORDED).tracker == RECORDED


def test_labels_are_needed_only_by_the_detector_that_reads_them(tmp_path: Path) -> None:
    path = with_images(tmp_path / "run.mcap", station="hardware")

    with pytest.raises(RunLogError, match="holds no label images of the camera 'left'"):
        SetUpReplay(path, scenario_text="{poil: {detector: label_image}}")


def test_unknown_times_are_noted(tmp_path: Path) -> None:
    path = with_images(tmp_path / "run.mcap", station="hardware")
    run = load_recorded_run(path)

    notes = NotesOn(run, ChooseScenario(), repeat_tracks=False)

    assert ["the run's clock" in notes[0], "/cameras/status" in notes[1]] == [True, True]
    assert len(NotesOn(run, ChooseScenario(), repeat_tracks=True)) == 1


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ((1.7e9, 1.7e9 + 0.5), "from 1.7e+09 s to 1.7e+09 s, with none between 0 s and 1.7e+09"),
        ((0.0, 0.5, 3600.0), "from 0 s to 3600 s, with none between 0.5 s and 3600 s"),
    ],
)
def test_a_log_of_other_times_is_refused(
    tmp_path: Path, times: tuple[float, ...], said: str
) -> None:
    path = with_samples(tmp_path, short_scenario(), times)

    with pytest.raises(RunLogError, match=re.escape(said)) as caught:
        SetUpReplay(path)

    assert "begins at time 0" in caught.value.problem


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("{poil: {rates: {plant: 1/1024}}}", "poil.rates.plant"),
        ("{poil: {rates: {control: 1/512, plant: 1/512}}}", "poil.rates.plant"),
        ("{poil: {rates: {tracker: 1/4}}}", "poil.rates.tracker"),
        ("{poil: {latency: 1/4}}", "poil.latency"),
        ("{cameras: {left: {output_delay: 0}, right: {output_delay: 0}}}", "output_delay"),
    ],
)
def test_a_replay_keeps_the_times_of_the_run(tmp_path: Path, text: str, key: str) -> None:
    path = with_images(tmp_path / "run.mcap", station="simulated")

    with pytest.raises(ScenarioError, match=f"{key} is .* a replay keeps the run's times"):
        SetUpReplay(path, scenario_text=text, tracker=RECORDED)


@pytest.mark.parametrize(
    ("text", "moved"),
    [
        (None, False),
        ("{poil: {eta: 2}}", False),
        ("{cameras: {left: {X_PB: {translation: [1, 0, 1]}}}}", True),
    ],
)
def test_moved_cameras_are_recognized(tmp_path: Path, text: str | None, moved: bool) -> None:
    path = with_images(tmp_path / "run.mcap", station="simulated")

    assert SetUpReplay(path, scenario_text=text, tracker=RECORDED).cameras_moved is moved


def test_tolerances_are_tighter_at_lower_speeds(moving: Path, tmp_path: Path) -> None:
    def usual(station: str) -> ReplayTolerances:
        path = with_images(tmp_path / f"{station}.mcap", station=station, tracked=False)
        return SetUpReplay(path).tolerances

    assert usual("simulated") == PERCEPTION_TOLERANCES
    assert usual("hardware") == PERCEPTION_TOLERANCES.at_speed(0.2)
    assert SetUpReplay(moving).tolerances == CONTROL_TOLERANCES


def test_what_a_log_lacks_is_noted(log: Path, tmp_path: Path) -> None:
    def spoil(values: dict[str, str]) -> dict[str, str]:
        return values | {"dropped_messages": "12", "drake_version": "0.1"}

    spoilt = rewritten(log, tmp_path / "spoilt.mcap", metadata=spoil)
    notes = "; ".join(SetUpReplay(spoilt).notes)

    assert "lacks 12 messages" in notes
    assert "written with drake 0.1" in notes

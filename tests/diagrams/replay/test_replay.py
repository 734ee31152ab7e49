"""A replay of a run repeats its commands, and reports where they differ."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from mcap.records import Message
from recorded_runs import beginning, moving_plan, record, rewritten
from short_skill import short_scenario

from poil_drake.diagrams.replay.replay import Replay
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import RunLogError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.comparison.tolerances import (
    JOINT_VELOCITY,
    LINEAR_VELOCITY,
    TRACKED_POINTS,
)
from poil_drake.recording.mcap.message_encoder import ColorEncoding
from poil_drake.recording.run_log.layout import JOINT_COMMANDS_TOPIC, JOINT_STATES_TOPIC
from poil_drake.recording.run_log.reader import load_recorded_run
from poil_drake.recording.run_log.writer import RunLogConfig
from poil_drake.reports.replay_summary import ReplaySummary

PERIOD = 1 / 256


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with the ground-truth tracker that ends in a fault because it grasped nothing."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    config = RunLogConfig(chunk_size=1 << 16)
    return record(path, short_scenario(), moving_plan(), 2.0, config=config)


def replay(path: Path, **options: object) -> ReplaySummary:
    return Replay(path, show_progress=False, **options)


def starts(summary: ReplaySummary) -> list[tuple[str, float, float]]:
    return [(p.name, p.recorded, p.replayed) for p in summary.comparison.phases]


def test_a_replay_of_recorded_tracks_is_the_run_to_the_last_bit(log: Path) -> None:
    summary = replay(log)

    assert summary.same
    assert summary.tracker == "recorded"
    # The log holds every input exactly, and nothing else affects the commands.
    commands = summary.comparison.statistics(JOINT_VELOCITY)
    assert (commands.count, commands.maximum) == (2.0 / PERIOD + 1, 0.0)
    assert summary.comparison.statistics(TRACKED_POINTS).maximum == 0.0
    assert [(name, again == first) for name, first, again in starts(summary)] == [
        (name, True) for name in ("wait", "approach", "descend", "grasp", "fault")
    ]
    moved = load_recorded_run(log).commands.values
    assert np.abs(moved).max() > 0.2  # The approach peaks at 0.1 pi rad/s.


def test_a_plant_that_steps_more_often_than_the_controller_is_replayed_as_well(
    tmp_path: Path,
) -> None:
    scenario = short_scenario("{poil: {rates: {plant: 1/512}}}")
    path = record(tmp_path / "run.mcap", scenario, moving_plan(), 2.0)

    summary = replay(path)

    assert summary.same
    assert summary.comparison.statistics(JOINT_VELOCITY).maximum == 0.0
    assert starts(summary)[-1][0] == "fault"


def test_a_dry_run_that_is_logged_within_the_control_periods_is_replayed_from_its_beginning(
    tmp_path: Path,
) -> None:
    scenario = short_scenario("{poil: {rates: {plant: 1/512}, hardware: {speed: 1}}}")
    path = record(tmp_path / "run.mcap", scenario, moving_plan(), 1.0)
    dry = rewritten(path, tmp_path / "dry.mcap", metadata=lambda v: v | {"station": "dry_run"})

    summary = replay(dry)

    assert summary.station == "dry_run"
    # The controller sees a simulated arm one period earlier than a kinematic one.
    assert summary.comparison.phases_agree, summary.closing_line()
    assert [name for name, _, _ in starts(summary)] == ["wait", "approach"]
    assert summary.comparison.statistics(JOINT_VELOCITY).maximum < 4.0 * 0.1 * np.pi / 256 + 1e-3


def test_a_request_to_stop_is_repeated(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", short_scenario(), moving_plan(), 1.0, stop_at=0.5)

    summary = replay(path)

    assert summary.same
    (name, first, again) = starts(summary)[-1]
    # The tick at 0.5 s sees the request, the next the stop, and the one after the fault.
    assert (name, first, again) == ("fault", 0.5 + 3 * PERIOD, 0.5 + 3 * PERIOD)


def test_a_changed_command_is_detected(log: Path, tmp_path: Path) -> None:
    def faster(topic: str, message: Message) -> bytes:
        if topic != JOINT_COMMANDS_TOPIC or message.log_time != 750_000_000:
            return message.data
        joints = JointStates.FromString(message.data)
        joints.joints[2].velocity += 0.01
        return joints.SerializeToString()

    summary = replay(rewritten(log, tmp_path / "tampered.mcap", message=faster))

    assert not summary.same
    first = summary.comparison.first
    assert (first.time, first.what, first.phase) == (0.75, JOINT_VELOCITY, "approach")
    assert first.size == pytest.approx(0.01)
    assert summary.closing_line().startswith(
        "DIFFERENT: from 0.75 s on, in phase 'approach', joint velocities differ by more than"
    )


def test_a_changed_measurement_changes_the_commands(log: Path, tmp_path: Path) -> None:
    def elsewhere(topic: str, message: Message) -> bytes:
        if topic != JOINT_STATES_TOPIC or message.log_time < 750_000_000:
            return message.data
        joints = JointStates.FromString(message.data)
        joints.joints[6].position += 0.02
        return joints.SerializeToString()

    summary = replay(rewritten(log, tmp_path / "tampered.mcap", message=elsewhere))

    first = summary.comparison.first
    # The previous update saw the sample logged at 0.75 s, which also holds its command.
    assert (first.time, first.what) == (0.75, JOINT_VELOCITY)
    # The gain along the approach is 4 / s and has settled by then; few operations round.
    settled = summary.comparison.differences[JOINT_VELOCITY].at(1.0)[0]
    assert settled == pytest.approx(4.0 * 0.02, abs=1e-9)


def test_other_settings_show_what_they_would_have_changed(log: Path) -> None:
    text = "{poil: {safety: {limiter: {velocity_scale: 0.05}}}}"

    summary = replay(log, scenario_text=text)

    assert summary.changed
    assert not summary.same
    # Joint 7 may move at 2.61 rad/s; a twentieth of that is less than the approach commands.
    assert summary.comparison.first.phase == "approach"
    assert summary.comparison.statistics(JOINT_VELOCITY).maximum == pytest.approx(
        0.1 * np.pi - 0.05 * 2.61, abs=0.01
    )


def test_a_log_that_is_cut_off_is_replayed_as_far_as_it_goes(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[:-40_000])

    summary = replay(cut)

    assert summary.same
    assert 0.5 < summary.replayed < 2.0
    assert f"the log is cut off: its last sample is at {summary.replayed:.2f} s" in summary.notes


def test_sparse_signals_are_held_and_noted(log: Path, tmp_path: Path) -> None:
    def seldom(topic: str, message: Message) -> bytes | None:
        dense = topic in ("/robot/joint_states", "/robot/status", "/hand/status")
        return None if dense and message.log_time % 31_250_000 else message.data

    summary = replay(rewritten(log, tmp_path / "sparse.mcap", message=seldom))

    assert "the robot's signals were logged only every 0.03125 s" in summary.notes[0]
    assert [name for name, _, _ in starts(summary)][:4] == ["wait", "approach", "descend", "grasp"]
    # Positions are up to 1/32 s old, at a speed of 0.1 pi rad/s and with a gain of 4 / s.
    assert summary.comparison.statistics(JOINT_VELOCITY).maximum < 4.0 * 0.1 * np.pi / 32 + 0.01


def test_the_outputs_are_written(log: Path, tmp_path: Path) -> None:
    outputs = OutputPaths(
        mcap=tmp_path / "again.mcap", png=tmp_path / "again.png", json=tmp_path / "again.json"
    )

    replay(log, outputs=outputs)

    figures = json.loads((tmp_path / "again.json").read_text())
    assert figures["same"] is figures["phases_agree"] is True
    assert figures["tracker"] == "recorded"
    assert figures["signals"][JOINT_VELOCITY]["phases"]["approach"]["count"] > 200
    assert (tmp_path / "again.png").stat().st_size > 10_000
    # The log of a replay can be replayed, and is distinguished from that of a run.
    again = replay(tmp_path / "again.mcap")
    assert again.same
    metadata = load_recorded_run(tmp_path / "again.mcap").metadata
    digest = hashlib.sha256(log.read_bytes()).hexdigest()
    assert (metadata["replay_of"], metadata["replay_of_sha256"]) == ("run.mcap", digest)
    assert (metadata["replay_tracker"], metadata["replay_scenario_text"]) == ("recorded", "")
    assert again.notes == ("this is the log of a replay of run.mcap, not of a run",)


def test_old_outputs_stay_if_the_log_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text("{}")
    (tmp_path / "damaged.mcap").write_bytes(b"no log")

    with pytest.raises(RunLogError):
        replay(tmp_path / "damaged.mcap", outputs=OutputPaths(json=tmp_path / "old.json"))

    assert (tmp_path / "old.json").read_text() == "{}"


def test_the_log_is_not_overwritten(log: Path) -> None:
    before = log.read_bytes()

    with pytest.raises(Exception, match="would overwrite the input"):
        replay(log, outputs=OutputPaths(mcap=log))

    assert log.read_bytes() == before


@pytest.mark.render
def test_perception_repeats_itself_exactly_where_the_images_are_exact(
    scenario: Scenario, plan: ExecutionPlan, tmp_path: Path
) -> None:
    config = RunLogConfig(color=ColorEncoding(format="raw"), exact_depth=True)
    path = record(tmp_path / "run.mcap", scenario, plan, 1.5, config=config)

    summary = replay(path)

    assert summary.tracker == "rigid_flow"
    tracks = summary.comparison.statistics(TRACKED_POINTS)
    # Captures every 1/8 s, released 3/16 s later; the last one at 1.3125 s.
    assert tracks.count == 10
    assert tracks.maximum == 0.0
    assert summary.comparison.tracks.unmatched == 0
    assert summary.comparison.statistics(JOINT_VELOCITY).maximum == 0.0
    assert summary.same


@pytest.mark.render
def test_perception_repeats_itself_closely_with_the_usual_images(
    whole_run: Path, tmp_path: Path
) -> None:
    summary = replay(beginning(whole_run / "run.mcap", tmp_path / "run.mcap", 7.0))

    assert summary.same, summary.closing_line()
    assert starts(summary)[-1][0] == "follow"
    # Rounded depth and compressed colours: not the same, but closer than the tracker's own error.
    tracks = summary.comparison.statistics(TRACKED_POINTS)
    assert 0.0 < tracks.median < 0.001
    points = summary.comparison.statistics_by_phase(TRACKED_POINTS)
    assert points["follow"].maximum < 0.003
    assert summary.comparison.statistics(JOINT_VELOCITY).maximum < 0.13
    # The difference reaches the commands only while the field moves the arm.
    phases = summary.comparison.statistics_by_phase(LINEAR_VELOCITY)
    assert phases["follow"].maximum > 0.0
    assert phases["lift"].maximum == 0.0


@pytest.fixture(scope="module")
def seen(whole_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first half second of a run, with images."""
    return beginning(whole_run / "run.mcap", tmp_path_factory.mktemp("seen") / "run.mcap", 0.5)


@pytest.mark.render
def test_moved_cameras_are_noted(seen: Path, tmp_path: Path) -> None:
    def elsewhere(topic: str, message: Message) -> bytes:
        transform = FrameTransform.FromString(message.data) if topic == "/tf" else None
        if transform is None or transform.child_frame_id != "left_optical_frame":
            return message.data
        transform.translation.z += 0.023
        return transform.SerializeToString()

    moved = rewritten(seen, tmp_path / "moved.mcap", message=elsewhere)

    assert replay(seen).notes == ()
    assert replay(moved).notes == (
        "in the run, camera 'left' was 23 mm from its position in the replay",
    )
    # Recorded tracks need no images.
    assert replay(moved, tracker="recorded").notes == ()


@pytest.mark.render
def test_an_image_that_is_damaged_ends_a_replay_and_is_named(seen: Path, tmp_path: Path) -> None:
    def spoil(topic: str, message: Message) -> bytes:
        if topic != "/camera/left/image" or message.log_time < 250_000_000:
            return message.data
        image = CompressedImage.FromString(message.data)
        image.data = image.data[:100]
        return image.SerializeToString()

    spoilt = rewritten(seen, tmp_path / "spoilt.mcap", message=spoil)

    with pytest.raises(RunLogError, match=r"spoilt.mcap, topic /camera/left/image, at 0.25 s: "):
        replay(spoilt)

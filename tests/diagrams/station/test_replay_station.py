"""A replayed station has the ports of the others, and outputs what the log contains."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from diagram_wiring import ports, wires
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, LeafSystem
from recorded_runs import record
from short_skill import short_plan, short_scenario

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.station.replay_station import (
    RecordedTimings,
    RecordedTracks,
    ReplayStation,
)
from poil_drake.errors import RunLogError
from poil_drake.perception.images import RgbdImage
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.run_log.reader import load_recorded_run
from poil_drake.recording.run_log.recorded_run import LoggedTrack, RecordedRun, Series
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.robots.panda import ARM_JOINTS
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.recorded_tracker import RecordedTracker

PERIOD = 1 / 256


class Controller(LeafSystem):
    """Records the position of the first joint that its updates see."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[float] = []
        self.DeclareVectorInputPort("position", 7)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)

    def _update(self, context: Context, state: DiscreteValues) -> None:
        self.seen.append(self.GetInputPort("position").Eval(context)[0])


def empty_run(path: Path, **metadata: str) -> RecordedRun:
    with RunLogWriter(path, metadata=metadata):
        pass
    return load_recorded_run(path)


def test_the_loop_is_the_same_but_for_its_station(tmp_path: Path) -> None:
    scenario, plan = short_scenario(), short_plan()
    run = load_recorded_run(
        record(tmp_path / "run.mcap", scenario, plan, 0.125), joint_names=ARM_JOINTS
    )
    with RunLogWriter(tmp_path / "simulated.mcap") as log:
        simulated = MakeClosedLoop(scenario, plan, log=log)
    station = ReplayStation(scenario, run, repeat_tracks=True)
    with RunLogWriter(tmp_path / "replayed.mcap") as log:
        replayed = MakeClosedLoop(scenario, plan, log=log, station=station)

    assert replayed.station is station
    assert isinstance(replayed.tracker, RecordedTracker)
    # The ground truth came from the simulator; no other connections differ.
    before, after = wires(simulated.diagram), wires(replayed.diagram)
    assert before - after == {("station.body_poses", "tracker.body_poses")}
    assert after - before == {("station.panda.position_commanded", "supervisor.position_commanded")}


def test_the_ports_are_those_of_the_real_station(tmp_path: Path) -> None:
    run = empty_run(tmp_path / "run.mcap")

    dut = ReplayStation(ChooseScenario(), run)

    inputs, outputs = ports(dut)
    assert inputs.keys() == {"panda.velocity", "panda.velocity_time", "hand.width"}
    assert outputs.keys() == {
        *("panda.position_measured", "panda.velocity_measured", "panda.torque_external"),
        *("panda.status", "panda.position_commanded", "hand.width_measured"),
        *("left.rgb_image", "left.depth_image", "left.rgbd_image", "left.image_time"),
        *("right.rgb_image", "right.depth_image", "right.rgbd_image", "right.image_time"),
    }
    assert dut.camera_names == ("left", "right")


def test_before_the_first_message_nothing_is_known(tmp_path: Path) -> None:
    dut = ReplayStation(ChooseScenario(), empty_run(tmp_path / "run.mcap"))
    context = dut.CreateDefaultContext()

    for name in ("panda.position_measured", "panda.status", "left.image_time"):
        assert np.isnan(dut.GetOutputPort(name).Eval(context)).all()
    assert dut.GetOutputPort("left.rgb_image").Eval(context).size() == 0
    assert np.isnan(dut.ArmPosition(context)).all()
    assert dut.clock is None


def test_images_appear_when_the_simulated_cameras_delivered_them(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, metadata={"station": "simulated"}) as log:
        image = RgbdImage(np.zeros((480, 640, 3), np.uint8), np.ones((480, 640), np.float32), 0.125)
        log.write_image("left", image.rgb, time=0.25, stamp=0.125)
        log.write_depth("left", image.depth, time=0.25, stamp=0.125)
        log.write_label("left", np.full((480, 640), 3, np.int16), time=0.25, stamp=0.125)
        log.write_label_ids({"cup": (3,)})
    dut = ReplayStation(ChooseScenario(), load_recorded_run(path))
    context = dut.CreateDefaultContext()
    shown = {}
    # The package's cameras deliver after 7/64 s.
    for time in (0.125 + 7 / 64 - PERIOD, 0.125 + 7 / 64):
        context.SetTime(time)
        shown[time] = dut.GetOutputPort("left.depth_image").Eval(context).size()

    assert list(shown.values()) == [0, 480 * 640]
    assert dut.GetOutputPort("left.label_image").Eval(context).data[0, 0, 0] == 3
    assert not dut.HasOutputPort("right.label_image")
    # From the log, not from the models of the scenario.
    assert dut.label_ids == {"cup": (3,)}


def test_images_of_real_cameras_are_there_before_a_capture(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, metadata={"station": "hardware"}) as log:
        log.write_image("left", np.zeros((480, 640, 3), np.uint8), time=0.5, stamp=0.4)
        log.write_depth("left", np.ones((480, 640), np.float32), time=0.5, stamp=0.4)
        looked = 127.5 * PERIOD
        times = {"begun": looked, "released": np.nan, "released_of": np.nan}
        log.write_status("/tracker/times", times, time=0.5)
    dut = ReplayStation(ChooseScenario(), load_recorded_run(path))
    context = dut.CreateDefaultContext()
    shown = []
    for tick in (126, 127, 128):
        context.SetTime(tick * PERIOD)
        shown.append(dut.GetOutputPort("left.image_time").Eval(context)[0])

    np.testing.assert_array_equal(shown, [np.nan, 0.4, 0.4])


@pytest.mark.parametrize(
    ("station", "offset", "unknown", "seen"),
    [
        # Updates see received signals before they are logged, a kinematic robot's when they are.
        ("hardware", 0.0, 1, [1.0, 2.0, 3.0]),
        ("simulated", 0.0, 1, [1.0, 2.0, 3.0]),
        # The real arm's first measurement shows at once, then the kinematic robot's own position.
        ("dry_run", 0.0, 1, [1.0, 1.0, 2.0]),
        # Samples within the periods hold the results of the updates at their beginning.
        ("dry_run", PERIOD / 2, 0, [0.0, 0.0, 1.0]),
        ("dry_run", PERIOD / 2, 1, [np.nan, 1.0, 1.0]),
    ],
)
def test_measurements_appear_at_their_recorded_times(
    tmp_path: Path, station: str, offset: float, unknown: int, seen: list[float]
) -> None:
    run = empty_run(tmp_path / "run.mcap", station=station)
    samples = [
        (k * PERIOD + offset, np.full(21, np.nan if k < unknown else float(k))) for k in range(4)
    ]
    run = dataclasses.replace(run, joints=Series.of(samples, 21))
    builder = DiagramBuilder()
    dut = builder.AddSystem(ReplayStation(ChooseScenario(), run))
    controller = builder.AddSystem(Controller())
    builder.Connect(
        dut.GetOutputPort("panda.position_measured"), controller.GetInputPort("position")
    )
    Simulator(builder.Build()).AdvanceTo(3 * PERIOD)

    np.testing.assert_array_equal(controller.seen, seen)


def tracked_run(
    *,
    statuses: Sequence[tuple[float, float]] = ((0.25, 1.0), (0.5, 2.0)),
    said: tuple[float, float] = (np.nan, np.nan),
    early: float = 0.0,
) -> RecordedRun:
    times = [
        # Time of logging, begun, released, released_of, status
        (0.01, [0.0, np.nan, np.nan, 0.0]),
        (0.13, [0.125, np.nan, np.nan, 0.0]),
        (0.2, [0.125, 0.1875, 0.0, said[0]]),
        (0.26, [0.25, 0.1875, 0.0, said[0]]),
        (0.44, [0.25, 0.4375 - early, 0.25, said[1]]),
    ]
    tracks = [
        LoggedTrack(0.2, TrackedPoints(np.eye(3), np.ones(3), 0.0)),
        LoggedTrack(0.44, TrackedPoints.lost(3, 0.25)),
    ]
    return RecordedRun(
        Path("run.mcap"),
        (),
        numbers={
            "/tracker/times": Series.of(times, 4),
            "/detector/times": Series.of([(0.1, [0.0625, 0.0625, 0.0625])], 3),
            "/tracker/status": Series.of([(time, [status]) for time, status in statuses], 1),
        },
        tracks=tracks,
    )


def test_the_schedules_are_those_of_the_log() -> None:
    tracker, detector = RecordedTimings(tracked_run(), period=1 / 256)

    assert list(tracker.captured) == [0.0, 0.125, 0.25]
    # What was captured at 0.125 s was never released.
    assert list(tracker.released) == [(0.1875, 0.0), (0.4375, 0.25)]
    assert list(detector.captured) == [0.0625]
    assert list(detector.released) == [(0.0625, 0.0625)]


def test_tracks_are_repeated_with_their_times_and_statuses() -> None:
    tracks = RecordedTracks(tracked_run())

    assert [(t.captured, t.released, t.status) for t in tracks] == [
        (0.0, 0.1875, TrackerStatus.TRACKING),
        (0.25, 0.4375, TrackerStatus.LOST),
    ]


def test_a_status_logged_with_the_track_takes_precedence() -> None:
    run = tracked_run(said=(TrackerStatus.LOST, TrackerStatus.TRACKING))

    tracks = RecordedTracks(run)

    assert [t.status for t in tracks] == [TrackerStatus.LOST, TrackerStatus.TRACKING]


def test_impossible_times_are_reported_with_their_topic() -> None:
    with pytest.raises(RunLogError, match=r"run.mcap, topic /tracker/times: .* precedes its"):
        RecordedTimings(tracked_run(early=0.2), period=1 / 256)


@pytest.mark.parametrize(
    "statuses", [(), ((0.25, np.nan), (0.5, np.nan)), ((0.25, 9.0), (0.5, -1.0))]
)
def test_unknown_statuses_follow_from_the_tracks(
    statuses: Sequence[tuple[float, float]],
) -> None:
    tracks = RecordedTracks(tracked_run(statuses=statuses))

    assert [t.status for t in tracks] == [TrackerStatus.TRACKING, TrackerStatus.LOST]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.875])
@pytest.mark.parametrize("period", [1 / 256, 0.005])
def test_captures_keep_their_offset_within_the_period(share: float, period: float) -> None:
    begun = [(k + share) * period for k in (3, 36, 70, 103)]
    run = tracked_run()
    run.numbers["/tracker/times"] = Series.of([(t, [t, np.nan, np.nan, np.nan]) for t in begun], 4)

    for timing in RecordedTimings(run, period=period):
        assert timing.offset == share * period


def test_without_captures_the_offset_is_zero() -> None:
    run = tracked_run()
    run.numbers |= {topic: Series.of([], 4) for topic in ("/tracker/times", "/detector/times")}

    assert RecordedTimings(run, period=1 / 256)[0].offset == 0.0

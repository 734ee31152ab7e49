import numpy as np
import pytest
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.logging.mcap_logger import McapLogger
from poil_drake.systems.logging.mcap_logger_config import McapLoggerConfig


class RecordedCalls:
    """Stands for a RunLogWriter: keeps what it was told."""

    def __init__(self):
        self.calls = []

    def __getattr__(self, name):
        return lambda *args, **kwargs: self.calls.append((name, args, kwargs))

    def of(self, name, first=None):
        return [
            (args, kwargs)
            for called, args, kwargs in self.calls
            if called == name and (first is None or args[0] == first)
        ]


@pytest.fixture
def log():
    return RecordedCalls()


@pytest.fixture
def reference():
    positions = np.arange(2 * 3 * 3, dtype=float).reshape(2, 3, 3)
    return PointTrajectory(np.array([0.0, 1.0]), positions, np.zeros((2, 3, 3)))


def make(log, **kwargs):
    return McapLogger(log=log, num_points=3, joint_names=["j1", "j2"], **kwargs)


def make_frame(stamp):
    camera = CameraModel("left", 4, 3, np.diag([5.0, 5.0, 1.0]), np.eye(4))
    image = RgbdImage(np.zeros((3, 4, 3), np.uint8), np.ones((3, 4), np.float32), stamp)
    return camera, image


def test_nothing_is_written_for_ports_that_are_not_connected(log):
    dut = make(log, statuses={"controller": ["tau"]})

    dut.ForcedPublish(dut.CreateDefaultContext())

    assert log.calls == []


def test_signals_are_written_at_the_period_and_at_the_start(log):
    dut = make(log, config=McapLoggerConfig(period=0.25))
    simulator = Simulator(dut)
    dut.GetInputPort("points").FixValue(simulator.get_mutable_context(), np.arange(9.0))

    simulator.AdvanceTo(0.5)

    written = log.of("write_points", "propagated")
    assert [kwargs["time"] for _, kwargs in written] == [0.0, 0.25, 0.5]
    np.testing.assert_array_equal(written[0][0][1], np.arange(9.0).reshape(3, 3))
    assert written[0][1]["confidence"] is None


def test_points_go_with_their_confidence(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("points").FixValue(context, np.full(9, np.nan))
    dut.GetInputPort("confidence").FixValue(context, [0.0, 0.5, 1.0])

    dut.ForcedPublish(context)

    ((_, kwargs),) = log.of("write_points", "propagated")
    np.testing.assert_array_equal(kwargs["confidence"], [0.0, 0.5, 1.0])


def test_a_frame_is_written_once_for_each_stamp_and_its_calibration_once(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    camera, _ = make_frame(0.0)
    for time, stamp in ((0.0, 0.0), (0.25, 0.0), (0.5, 0.5)):
        context.SetTime(time)
        frame = MultiViewFrame((camera,), (make_frame(stamp)[1],))
        dut.GetInputPort("frame").FixValue(context, Value[object](frame))
        dut.ForcedPublish(context)

    assert [k["stamp"] for _, k in log.of("write_image", "left")] == [0.0, 0.5]
    assert [k["time"] for _, k in log.of("write_depth", "left")] == [0.0, 0.5]
    assert len(log.of("write_calibration")) == 1


@pytest.mark.parametrize(("color", "depth"), [(True, False), (False, True)])
def test_kinds_of_images_can_be_left_out(log, color, depth):
    dut = make(log, config=McapLoggerConfig(color=color, depth=depth))
    context = dut.CreateDefaultContext()
    camera, image = make_frame(0.0)
    frame = MultiViewFrame((camera,), (image,))
    dut.GetInputPort("frame").FixValue(context, Value[object](frame))

    dut.ForcedPublish(context)

    assert (len(log.of("write_image")), len(log.of("write_depth"))) == (color, depth)


def test_no_frame_and_no_track_yet_write_nothing(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("frame").FixValue(context, Value(ABSENT))
    dut.GetInputPort("tracked_points").FixValue(context, TrackedPoints.lost(3, -np.inf))

    dut.ForcedPublish(context)

    assert log.calls == []


def test_tracked_points_are_written_once_for_each_stamp(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    for time, stamp in ((0.25, 0.125), (0.5, 0.125), (0.75, 0.625)):
        context.SetTime(time)
        points = TrackedPoints(np.eye(3), np.ones(3), stamp)
        dut.GetInputPort("tracked_points").FixValue(context, points)
        dut.ForcedPublish(context)

    written = [(k["time"], k["stamp"]) for _, k in log.of("write_points", "tracked")]
    assert written == [(0.25, 0.125), (0.75, 0.625)]


def test_a_phase_is_written_when_it_begins(log):
    dut = make(log, phase_names=["wait", "follow"])
    context = dut.CreateDefaultContext()
    for time, phase in ((0.0, 0.0), (0.25, 0.0), (0.5, 1.0)):
        context.SetTime(time)
        dut.GetInputPort("phase").FixValue(context, [phase])
        dut.ForcedPublish(context)

    assert [(args[0], k["time"]) for args, k in log.of("write_phase")] == [
        ("wait", 0.0),
        ("follow", 0.5),
    ]


def test_a_phase_is_written_with_its_reason(log):
    dut = make(
        log,
        phase_names=["wait", "fault"],
        phase_reason=lambda phase, fault: f"phase {phase}, fault {fault}",
    )
    context = dut.CreateDefaultContext()
    dut.GetInputPort("phase").FixValue(context, [0.0])
    dut.ForcedPublish(context)
    dut.GetInputPort("phase").FixValue(context, [1.0])
    dut.GetInputPort("fault").FixValue(context, [5.0])
    dut.ForcedPublish(context)

    assert [(args[0], kwargs["reason"]) for args, kwargs in log.of("write_phase")] == [
        ("wait", "phase 0, fault 0"),
        ("fault", "phase 1, fault 5"),
    ]


@pytest.mark.parametrize(
    ("number", "text"), [(2.0, "lost"), (9.0, "9"), (np.nan, "unknown")], ids=str
)
def test_what_a_status_means_is_written_beside_it(log, number, text):
    dut = make(log, statuses={"tracker": ["status", "age"]}, texts={"tracker.status": {2: "lost"}})
    context = dut.CreateDefaultContext()
    dut.GetInputPort("tracker.status").FixValue(context, [number])
    dut.GetInputPort("tracker.age").FixValue(context, [0.125])

    dut.ForcedPublish(context)

    (((topic, values), _),) = log.of("write_status")
    assert topic == "/tracker/status"
    assert list(values) == ["status", "status_text", "age"]
    assert (values["status_text"], values["age"]) == (text, 0.125)


def test_the_robots_mode_and_the_age_of_its_status_are_written(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("panda.status").FixValue(context, [4.0, 0.03, 0.98])

    dut.ForcedPublish(context)

    (((topic, values), _),) = log.of("write_status")
    assert topic == "/robot/status"
    assert values == {"mode": 4.0, "mode_text": "reflex", "age": 0.03, "success_rate": 0.98}


def test_a_push_is_written_while_it_lasts_and_when_it_is_over(log):
    dut = make(log, body_names=["world", "mug::body"])
    context = dut.CreateDefaultContext()
    for time, force in ((0.0, 0.0), (0.25, 3.0), (0.5, 1.0), (0.75, 0.0), (1.0, 0.0)):
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = BodyIndex(1)
        applied.F_Bq_W = SpatialForce(tau=[0.0, 0.0, 0.1 * force], f=[force, 0.0, 0.0])
        context.SetTime(time)
        port = dut.GetInputPort("applied_spatial_force")
        port.FixValue(context, AbstractValue.Make([applied]))
        dut.ForcedPublish(context)

    written = [(k["time"], a[1]["applied"]) for a, k in log.of("write_status")]
    assert [time for time, _ in written] == [0.25, 0.5, 0.75]
    (push,) = written[0][1]
    assert push["body"] == "mug::body"
    np.testing.assert_array_equal(push["force"], [3.0, 0.0, 0.0])
    np.testing.assert_allclose(push["torque"], [0.0, 0.0, 0.3])
    assert written[2][1] == []


def test_status_fields_of_a_topic_are_written_together(log):
    dut = make(log, statuses={"controller": ["tau", "potential"], "ik": ["scale"]})
    context = dut.CreateDefaultContext()
    dut.GetInputPort("controller.tau").FixValue(context, [1.5])
    dut.GetInputPort("controller.potential").FixValue(context, [0.25])

    dut.ForcedPublish(context)

    ((args, _),) = log.of("write_status")
    assert args == ("/controller/status", {"tau": 1.5, "potential": 0.25})


def test_joints_twist_and_gripper_are_written(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    X_WG = np.eye(4)
    X_WG[:3, 3] = [0.4, 0.0, 0.3]
    for name, value in {
        "panda.position_measured": [0.1, 0.2],
        "panda.velocity": [0.3, 0.4],
        "spatial_velocity": np.arange(6.0),
        "gripper_pose": X_WG.ravel(),
    }.items():
        dut.GetInputPort(name).FixValue(context, value)

    dut.ForcedPublish(context)

    states, commands = log.of("write_joint_states")
    np.testing.assert_array_equal(states[1]["position"], [0.1, 0.2])
    assert states[1]["velocity"] is None
    assert commands[1]["topic"] == "/robot/joint_commands"
    np.testing.assert_array_equal(log.of("write_twist")[0][0][1], np.arange(6.0))
    np.testing.assert_array_equal(log.of("write_transform")[0][0][0], X_WG)


def test_an_unknown_gripper_pose_is_left_out(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("gripper_pose").FixValue(context, np.full(16, np.nan))

    dut.ForcedPublish(context)

    assert log.calls == []


def test_the_reference_is_written_once(log, reference):
    dut = make(log, reference=reference)

    Simulator(dut).AdvanceTo(0.5)

    ((args, _),) = log.of("write_points", "reference")
    np.testing.assert_array_equal(args[1], reference.positions.reshape(6, 3))


def test_close_closes_the_log(log):
    make(log).Close()

    assert log.of("close") == [((), {})]


def test_a_real_log_takes_everything(tmp_path, reference):
    from mcap.reader import make_reader

    from poil_drake.recording.run_log.writer import RunLogWriter

    path = tmp_path / "run.mcap"
    dut = make(
        RunLogWriter(path), reference=reference, phase_names=["go"], statuses={"ik": ["scale"]}
    )
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    camera, image = make_frame(0.0)
    frame = MultiViewFrame((camera,), (image,))
    dut.GetInputPort("frame").FixValue(context, Value[object](frame))
    points = TrackedPoints(np.eye(3), np.ones(3), 0.0)
    dut.GetInputPort("tracked_points").FixValue(context, points)
    for name, value in {
        "points": np.arange(9.0),
        "confidence": np.ones(3),
        "target_points": np.full(9, np.nan),
        "gripper_pose": np.eye(4).ravel(),
        "spatial_velocity": np.full(6, np.nan),
        "panda.position_measured": np.zeros(2),
        "panda.velocity_measured": np.zeros(2),
        "panda.torque_external": np.zeros(2),
        "panda.velocity": np.zeros(2),
        "phase": np.zeros(1),
        "fault": np.zeros(1),
        "panda.status": np.array([2.0, 0.0, 1.0]),
        "ik.scale": np.ones(1),
    }.items():
        dut.GetInputPort(name).FixValue(context, value)

    simulator.AdvanceTo(0.125)
    dut.Close()

    with path.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    assert topics == {
        "/camera/left/calibration",
        "/camera/left/depth",
        "/camera/left/image",
        "/controller/twist",
        "/ik/status",
        "/phase",
        "/points/propagated",
        "/points/reference",
        "/points/target",
        "/points/tracked",
        "/robot/joint_commands",
        "/robot/joint_states",
        "/robot/status",
        "/tf",
    }


def test_the_robots_signals_have_a_period_of_their_own(log):
    config = McapLoggerConfig(period=0.5, robot_period=0.125)
    dut = make(log, config=config, statuses={"hand": ["width_measured"], "ik": ["scale"]})
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    for name, value in {
        "panda.position_measured": np.zeros(2),
        "points": np.zeros(9),
        "hand.width_measured": [0.03],
        "ik.scale": [1.0],
    }.items():
        dut.GetInputPort(name).FixValue(context, value)

    simulator.AdvanceTo(0.5)

    def times(name, first=None):
        return [kwargs["time"] for _, kwargs in log.of(name, first)]

    often, seldom = [0.0, 0.125, 0.25, 0.375, 0.5], [0.0, 0.5]
    assert times("write_joint_states") == often
    assert times("write_status", "/hand/status") == often
    assert times("write_status", "/ik/status") == seldom
    assert times("write_points", "propagated") == seldom


def test_the_robots_signals_may_begin_later(log):
    dut = make(log, config=McapLoggerConfig(period=0.5, robot_period=0.25, robot_offset=0.125))
    simulator = Simulator(dut)
    dut.GetInputPort("panda.position_measured").FixValue(
        simulator.get_mutable_context(), np.zeros(2)
    )

    simulator.AdvanceTo(0.5)

    assert [k["time"] for _, k in log.of("write_joint_states")] == [0.125, 0.375]


def test_labels_are_written_once_for_each_stamp_and_what_they_stand_for_once(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    camera, image = make_frame(0.25)
    labelled = RgbdImage(image.rgb, image.depth, 0.25, label=np.ones((3, 4), np.int16))
    for time, name, shown in (
        (0.25, "frame", image),
        (0.5, "detector.frame", labelled),
        (0.75, "detector.frame", labelled),
    ):
        context.SetTime(time)
        ids = {"mug": (1,)} if shown.label is not None else {}
        frame = MultiViewFrame((camera,), (shown,), ids)
        dut.GetInputPort(name).FixValue(context, Value[object](frame))
        dut.ForcedPublish(context)

    # The detector looked at the image that the tracker had had already.
    assert [(k["time"], k["stamp"]) for _, k in log.of("write_image")] == [(0.25, 0.25)]
    assert [(k["time"], k["stamp"]) for _, k in log.of("write_label", "left")] == [(0.5, 0.25)]
    assert [dict(args[0]) for args, _ in log.of("write_label_ids")] == [{"mug": (1,)}]


def test_times_of_perception_are_written_when_they_change(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    for time, times in (
        (0.0, [-np.inf] * 3),
        (0.25, [0.125, -np.inf, -np.inf]),
        (0.5, [0.125, -np.inf, -np.inf]),
        (0.75, [0.625, 0.5, 0.125]),
    ):
        context.SetTime(time)
        dut.GetInputPort("tracker.times").FixValue(context, times)
        dut.ForcedPublish(context)

    written = [(k["time"], args[1]) for args, k in log.of("write_status", "/tracker/times")]
    assert written == [
        (0.25, {"begun": 0.125, "released": -np.inf, "released_of": -np.inf}),
        (0.75, {"begun": 0.625, "released": 0.5, "released_of": 0.125}),
    ]


def test_what_a_tracker_thinks_goes_with_its_times(log):
    dut = make(log, statuses={"tracker": ["status"]}, config=McapLoggerConfig(robot_period=0.125))
    context = dut.CreateDefaultContext()
    dut.GetInputPort("tracker.times").FixValue(context, [0.125, 0.1875, 0.125])
    for time, status in ((0.25, 1.0), (0.5, 1.0), (0.75, 2.0)):
        context.SetTime(time)
        dut.GetInputPort("tracker.status").FixValue(context, [status])
        dut.ForcedPublish(context)

    written = log.of("write_status", "/tracker/times")
    assert [(k["time"], a[1]["status"]) for a, k in written] == [(0.25, 1.0), (0.75, 2.0)]


@pytest.mark.parametrize(
    ("age", "times"),
    [
        # The image of 0.3125 s is noticed at once, and the rest is the usual period.
        (0.1, [0.0, 0.375, 0.5]),
        # Cameras whose images are of the moment say nothing by that.
        (0.0, [0.0, 0.5]),
    ],
)
def test_when_images_came_is_written_as_soon_as_one_has_come(log, age, times):
    config = McapLoggerConfig(period=0.5, robot_period=0.125)
    dut = make(log, statuses={"cameras": ["left.image_time", "right.image_time"]}, config=config)
    builder = DiagramBuilder()
    builder.AddSystem(dut)

    class Camera(LeafSystem):
        def __init__(self):
            super().__init__()
            self.DeclareVectorOutputPort("time", 1, self._calc)

        def _calc(self, context, output):
            now = context.get_time()
            came = now if age == 0.0 else 0.3125 if now > 0.3125 else np.nan
            output.SetAtIndex(0, came)

    camera = builder.AddSystem(Camera())
    builder.Connect(camera.get_output_port(), dut.GetInputPort("cameras.left.image_time"))
    simulator = Simulator(builder.Build())
    context = dut.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    dut.GetInputPort("cameras.right.image_time").FixValue(context, [np.nan])

    simulator.AdvanceTo(0.5)

    written = log.of("write_status", "/cameras/status")
    assert [kwargs["time"] for _, kwargs in written] == times


def test_requests_to_stop_are_written_when_there_are_more(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    for time, stops in ((0.0, 0.0), (0.25, 0.0), (0.5, 2.0), (0.75, 2.0)):
        context.SetTime(time)
        dut.GetInputPort("stop").FixValue(context, [stops])
        dut.ForcedPublish(context)

    written = [(k["time"], a[1]["requests"]) for a, k in log.of("write_status")]
    assert written == [(0.0, 0.0), (0.5, 2.0)]


def test_the_clock_goes_with_the_robots_status(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("panda.status").FixValue(context, [2.0, 0.0, 1.0])
    dut.GetInputPort("clock").FixValue(context, [1.7e9])

    dut.ForcedPublish(context)

    assert log.of("write_status")[0][0][1]["clock"] == 1.7e9


def test_tracks_lose_nothing(log):
    dut = make(log)
    context = dut.CreateDefaultContext()
    points = TrackedPoints(np.eye(3), np.ones(3), 0.0)
    dut.GetInputPort("tracked_points").FixValue(context, points)

    dut.ForcedPublish(context)

    assert log.of("write_points", "tracked")[0][1]["exact"] is True

from collections.abc import Mapping
from dataclasses import replace
from unittest.mock import create_autospec

import numpy as np
import pytest
from mcap.reader import make_reader
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from small_frames import make_frame
from system_bench import SystemBench

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.run_log.reader import load_recorded_run
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.logging.mcap_logger import McapLogger


@pytest.fixture
def log():
    return create_autospec(RunLogWriter, instance=True)


def calls(method, first=None):
    """Returns the arguments and keywords of a method's calls, or of those with a first argument."""
    found = [(call.args, call.kwargs) for call in method.call_args_list]
    return [(args, kwargs) for args, kwargs in found if first in (None, args[0])]


def times_of(method, first=None):
    return [kwargs["time"] for _, kwargs in calls(method, first)]


def statuses_of(log, topic=None):
    """Returns time -> values of a status topic, or of all."""
    return {kwargs["time"]: args[1] for args, kwargs in calls(log.write_status, topic)}


@pytest.fixture
def reference():
    positions = np.arange(2 * 3 * 3, dtype=float).reshape(2, 3, 3)
    return PointTrajectory(np.array([0.0, 1.0]), positions, np.zeros((2, 3, 3)))


def make(log, **kwargs):
    return McapLogger(log=log, num_points=3, joint_names=["j1", "j2"], **kwargs)


def publish(dut, inputs: Mapping, *, times=(0.0,)):
    """Publishes once at each time [s].

    A list at a port has one value for each time; None leaves the port as it is.
    """
    bench = SystemBench(dut)
    for k, time in enumerate(times):
        bench.context.SetTime(time)
        for port, values in inputs.items():
            value = values[k] if isinstance(values, list) else values
            if value is not None:
                bench.fix(port, value)
        dut.ForcedPublish(bench.context)


def track(stamp):
    return TrackedPoints(np.eye(3), np.ones(3), stamp)


@pytest.mark.parametrize(
    "inputs",
    [
        {},
        {"frame": ABSENT, "tracked_points": TrackedPoints.lost(3, -np.inf)},
        {"gripper_pose": np.full(16, np.nan)},
    ],
    ids=["not connected", "no frame and no track yet", "unknown gripper pose"],
)
def test_signals_without_a_value_are_not_written(log, inputs):
    publish(make(log, statuses={"controller": ["tau"]}), inputs)

    assert log.mock_calls == []


@pytest.mark.parametrize("confidence", [None, np.array([0.0, 0.5, 1.0])])
def test_points_are_written_at_the_period_and_at_the_start(log, confidence):
    given = {} if confidence is None else {"confidence": confidence}
    bench = SystemBench(make(log, period=0.25), points=np.arange(9.0), **given)

    bench.advance(0.5)

    assert times_of(log.write_points, "propagated") == [0.0, 0.25, 0.5]
    (_, points), kwargs = calls(log.write_points, "propagated")[0]
    np.testing.assert_array_equal(points, np.arange(9.0).reshape(3, 3))
    np.testing.assert_array_equal(kwargs["confidence"], confidence)


def test_the_robots_signals_have_their_own_period(log):
    statuses = {"hand": ["width_measured"], "ik": ["scale"]}
    bench = SystemBench(make(log, period=0.5, robot_period=0.125, statuses=statuses))
    for port in ("panda.position_measured", "hand.width_measured", "points", "ik.scale"):
        size = bench.dut.GetInputPort(port).size()
        bench.fix(port, np.zeros(size))

    bench.advance(0.5)

    often, seldom = [0.0, 0.125, 0.25, 0.375, 0.5], [0.0, 0.5]
    assert times_of(log.write_joint_states) == often
    assert times_of(log.write_status, "/hand/status") == often
    assert times_of(log.write_status, "/ik/status") == seldom
    assert times_of(log.write_points, "propagated") == seldom


def test_the_robots_signals_may_begin_later(log):
    bench = SystemBench(make(log, period=0.5, robot_period=0.25, robot_offset=0.125))
    bench.fix("panda.position_measured", np.zeros(2))

    bench.advance(0.5)

    assert times_of(log.write_joint_states) == [0.125, 0.375]


def test_images_are_read_under_the_names_of_their_cameras(tmp_path):
    frame = make_frame(0, ("right", "Top", "left", "10"))
    images = [replace(im, depth=np.full_like(im.depth, k)) for k, im in enumerate(frame.images, 1)]
    with RunLogWriter(tmp_path / "run.mcap") as log:
        publish(make(log), {"frame": replace(frame, images=tuple(images))})

    run = load_recorded_run(tmp_path / "run.mcap", joint_names=["j1", "j2"])

    depths = {camera.name: run.image_reader(camera)(0).depth for camera in frame.cameras}
    assert {name: float(np.max(depth)) for name, depth in depths.items()} == {
        "right": 1.0,
        "Top": 2.0,
        "left": 3.0,
        "10": 4.0,
    }


def test_a_frame_is_written_once_for_each_stamp_and_its_calibration_once(log):
    frames = [make_frame(index, ("left",)) for index in (0, 0, 4)]  # At 0 and 0.5 s.

    publish(make(log), {"frame": frames}, times=(0.0, 0.25, 0.5))

    assert [k["stamp"] for _, k in calls(log.write_image, "left")] == [0.0, 0.5]
    assert times_of(log.write_depth, "left") == [0.0, 0.5]
    assert len(calls(log.write_calibration)) == 1


def test_labels_are_written_once_for_each_stamp_and_their_meanings_once(log):
    labelled = make_frame(2, ("left",), labelled=True)
    frames = {"frame": make_frame(2, ("left",)), "detector.frame": [ABSENT, labelled, labelled]}

    publish(make(log), frames, times=(0.25, 0.5, 0.75))

    # The tracker has used the detector's image before.
    assert [(k["time"], k["stamp"]) for _, k in calls(log.write_image)] == [(0.25, 0.25)]
    assert [(k["time"], k["stamp"]) for _, k in calls(log.write_label, "left")] == [(0.5, 0.25)]
    assert [dict(args[0]) for args, _ in calls(log.write_label_ids)] == [labelled.label_ids]


def test_tracked_points_are_written_exactly_and_once_for_each_stamp(log):
    tracks = [track(stamp) for stamp in (0.125, 0.125, 0.625)]

    publish(make(log), {"tracked_points": tracks}, times=(0.25, 0.5, 0.75))

    written = [kwargs for _, kwargs in calls(log.write_points, "tracked")]
    assert [(k["time"], k["stamp"], k["exact"]) for k in written] == [
        (0.25, 0.125, True),
        (0.75, 0.625, True),
    ]


def test_a_phase_is_written_when_it_begins_with_its_reason(log):
    dut = make(
        log,
        phase_names=["wait", "fault"],
        phase_reason=lambda phase, fault: f"phase {phase}, fault {fault}",
    )

    publish(dut, {"phase": [0.0, 0.0, 1.0], "fault": [None, None, 5.0]}, times=(0.0, 0.25, 0.5))

    assert [(args[0], k["time"], k["reason"]) for args, k in calls(log.write_phase)] == [
        ("wait", 0.0, "phase 0, fault 0"),
        ("fault", 0.5, "phase 1, fault 5"),
    ]


@pytest.mark.parametrize(
    ("number", "text"), [(2.0, "lost"), (9.0, "9"), (np.nan, "unknown")], ids=str
)
def test_the_meaning_of_a_status_is_written_beside_it(log, number, text):
    statuses = {"tracker": ["status", "age"], "ik": ["scale"]}
    dut = make(log, statuses=statuses, texts={"tracker.status": {2: "lost"}})

    publish(dut, {"tracker.status": number, "tracker.age": 0.125})

    (((topic, values), _),) = calls(log.write_status)
    assert topic == "/tracker/status"
    assert list(values) == ["status", "status_text", "age"]
    assert (values["status_text"], values["age"]) == (text, 0.125)


@pytest.mark.parametrize("clock", [{}, {"clock": 1.7e9}], ids=["without clock", "with clock"])
def test_the_robots_mode_the_age_of_its_status_and_the_clock_are_written(log, clock):
    publish(make(log), {"panda.status": np.array([4.0, 0.03, 0.98]), **clock})

    (values,) = statuses_of(log, "/robot/status").values()
    expected = {"mode": 4.0, "mode_text": "reflex", "age": 0.03, "success_rate": 0.98}
    assert values == expected | clock


def test_a_push_is_written_while_it_lasts_and_when_it_is_over(log):
    def push(force):
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = BodyIndex(1)
        applied.F_Bq_W = SpatialForce(tau=[0.0, 0.0, 0.1 * force], f=[force, 0.0, 0.0])
        return AbstractValue.Make([applied])

    pushes = [push(force) for force in (0.0, 3.0, 1.0, 0.0, 0.0)]
    dut = make(log, body_names=["world", "mug::body"])

    publish(dut, {"applied_spatial_force": pushes}, times=(0.0, 0.25, 0.5, 0.75, 1.0))

    written = {time: values["applied"] for time, values in statuses_of(log).items()}
    assert list(written) == [0.25, 0.5, 0.75]
    (pushed,) = written[0.25]
    assert pushed["body"] == "mug::body"
    np.testing.assert_array_equal(pushed["force"], [3.0, 0.0, 0.0])
    np.testing.assert_allclose(pushed["torque"], [0.0, 0.0, 0.3])
    assert written[0.75] == []


def test_joints_twist_and_gripper_are_written(log):
    X_WG = np.eye(4)
    X_WG[:3, 3] = [0.4, 0.0, 0.3]

    publish(
        make(log),
        {
            "panda.position_measured": np.array([0.1, 0.2]),
            "panda.velocity": np.array([0.3, 0.4]),
            "spatial_velocity": np.arange(6.0),
            "gripper_pose": X_WG,
        },
    )

    states, commands = calls(log.write_joint_states)
    np.testing.assert_array_equal(states[1]["position"], [0.1, 0.2])
    assert states[1]["velocity"] is None
    assert commands[1]["topic"] == "/robot/joint_commands"
    np.testing.assert_array_equal(calls(log.write_twist)[0][0][1], np.arange(6.0))
    np.testing.assert_array_equal(calls(log.write_transform)[0][0][0], X_WG)


def test_the_reference_is_written_once(log, reference):
    SystemBench(make(log, reference=reference)).advance(0.5)

    ((args, _),) = calls(log.write_points, "reference")
    np.testing.assert_array_equal(args[1], reference.positions.reshape(6, 3))


NEVER = -np.inf
BEGUN = np.array([0.125, NEVER, NEVER])


@pytest.mark.parametrize(
    ("inputs", "topic", "written"),
    [
        (
            {
                "tracker.times": [np.full(3, NEVER), BEGUN, BEGUN, np.array([0.625, 0.5, 0.125])],
            },
            "/tracker/times",
            {
                0.25: {"begun": 0.125, "released": NEVER, "released_of": NEVER},
                0.75: {"begun": 0.625, "released": 0.5, "released_of": 0.125},
            },
        ),
        (
            {"tracker.times": BEGUN, "tracker.status": [1.0, 1.0, 2.0, 2.0]},
            "/tracker/times",
            {
                0.0: {"begun": 0.125, "released": NEVER, "released_of": NEVER, "status": 1.0},
                0.5: {"begun": 0.125, "released": NEVER, "released_of": NEVER, "status": 2.0},
            },
        ),
        (
            {"stop": [0.0, 0.0, 2.0, 2.0]},
            "/stop_requests/status",
            {0.0: {"requests": 0.0}, 0.5: {"requests": 2.0}},
        ),
    ],
    ids=["times", "status of the tracker", "requests to stop"],
)
def test_some_statuses_are_written_when_they_change(log, inputs, topic, written):
    statuses = {"tracker": ["status"]} if "tracker.status" in inputs else {}

    publish(make(log, statuses=statuses), inputs, times=(0.0, 0.25, 0.5, 0.75))

    assert statuses_of(log, topic) == written


@pytest.mark.parametrize(
    ("age", "times"),
    [
        # The image of 0.3125 s is written at once, and then at the usual period.
        (0.1, [0.0, 0.375, 0.5]),
        # Images of cameras without a delay are written at the period only.
        (0.0, [0.0, 0.5]),
    ],
)
def test_image_times_are_written_as_soon_as_an_image_arrives(log, age, times):
    statuses = {"cameras": ["left.image_time", "right.image_time"]}
    dut = make(log, statuses=statuses, period=0.5, robot_period=0.125)
    builder = DiagramBuilder()
    builder.AddSystem(dut)

    class Camera(LeafSystem):
        def __init__(self):
            super().__init__()
            self.DeclareVectorOutputPort("time", 1, self._calc)

        def _calc(self, context, output):
            now = context.get_time()
            stamp = now if age == 0.0 else 0.3125 if now > 0.3125 else np.nan
            output.SetAtIndex(0, stamp)

    camera = builder.AddSystem(Camera())
    builder.Connect(camera.get_output_port(), dut.GetInputPort("cameras.left.image_time"))
    bench = SystemBench(dut, builder.Build())
    bench.fix("cameras.right.image_time", np.nan)

    bench.advance(0.5)

    assert times_of(log.write_status, "/cameras/status") == times


def test_a_real_log_takes_everything(tmp_path, reference):
    path = tmp_path / "run.mcap"
    with RunLogWriter(path) as log:
        bench = SystemBench(
            make(log, reference=reference, phase_names=["go"], statuses={"ik": ["scale"]}),
            frame=make_frame(0, ("left",)),
            tracked_points=track(0.0),
        )
        for port, value in {
            "points": np.arange(9.0),
            "confidence": np.ones(3),
            "target_points": np.full(9, np.nan),
            "gripper_pose": np.eye(4),
            "spatial_velocity": np.full(6, np.nan),
            "panda.position_measured": np.zeros(2),
            "panda.velocity_measured": np.zeros(2),
            "panda.torque_external": np.zeros(2),
            "panda.velocity": np.zeros(2),
            "phase": 0.0,
            "fault": 0.0,
            "panda.status": np.array([2.0, 0.0, 1.0]),
            "ik.scale": 1.0,
        }.items():
            bench.fix(port, value)
        bench.advance(0.125)

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

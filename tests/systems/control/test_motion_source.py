import numpy as np
import pytest
from system_bench import SystemBench

from poil_drake.control.field.straight_motion import StraightMotionConfig, straight_motion_twist
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.systems.control.motion_source import JOINT_GAIN, MotionSource
from poil_drake.systems.skill.phases import Phase

APPROACH = JointTrajectory([0.0, 1.0], [[0.0] * 7, [0.5] * 7], [[0.5] * 7] * 2)
DESCENT = JointTrajectory([0.0, 2.0], [[0.5] * 7, [0.7] * 7], [[0.1] * 7] * 2)
FIELD = np.arange(6.0) / 10
IK = np.arange(7.0) / 10
# Approaching straight down: the gripper's z axis is the world's -z.
X_WG = np.diag([1.0, -1.0, -1.0, 1.0])
X_WG[:3, 3] = [0.5, 0.0, 0.3]
UP = np.array([0.0, 0.0, 1.0])


def make_bench(phase: float, time: float = 0.0, **changed) -> SystemBench:
    bench = SystemBench(
        MotionSource(approach=APPROACH, descent=DESCENT),
        **{
            "phase": phase,
            "phase_start": 0.0,
            "position_measured": np.full(7, 0.1),
            "gripper_pose": X_WG,
            "field_velocity": FIELD,
            "ik_velocity": IK,
        }
        | changed,
    )
    bench.advance_to(time)
    return bench


@pytest.mark.parametrize(
    "phase", [Phase.WAIT, Phase.GRASP, Phase.RELEASE, Phase.SETTLE, Phase.DONE, Phase.FAULT]
)
def test_the_arm_rests_in_phases_without_motion(phase: Phase) -> None:
    bench = make_bench(phase, time=0.5)

    assert not bench.read("velocity").any()
    assert not bench.read("spatial_velocity").any()


@pytest.mark.parametrize(
    ("phase", "joints", "expected"),
    [
        # Feedforward 0.5 rad/s, 0.15 rad short, gain 4 / s.
        (Phase.APPROACH, APPROACH, 1.1),
        # Feedforward 0.1 rad/s, 0.45 rad short.
        (Phase.DESCEND, DESCENT, 1.9),
    ],
)
def test_joint_phases_follow_their_trajectory_with_feedback(
    phase: Phase, joints: JointTrajectory, expected: float
) -> None:
    bench = make_bench(phase, time=0.5)
    assert bench.read("velocity") == pytest.approx(np.full(7, expected))
    assert bench.read("motion_done")[0] == 0.0

    ended = make_bench(phase, joints.duration, position_measured=joints.positions[-1] + 0.019)
    assert ended.read("motion_done")[0] == 1.0


def test_an_arm_that_was_held_up_has_not_ended_its_motion() -> None:
    short = APPROACH.positions[-1] - 0.021 * np.eye(7)[2]
    bench = make_bench(Phase.APPROACH, time=9.0, position_measured=short)

    assert bench.read("motion_done")[0] == 0.0
    # It continues towards the end.
    assert bench.read("velocity")[2] == pytest.approx(0.021 * JOINT_GAIN)


def test_following_passes_the_field_and_the_inverse_kinematics() -> None:
    bench = make_bench(Phase.FOLLOW)

    assert bench.read("spatial_velocity") == pytest.approx(FIELD)
    assert bench.read("velocity") == pytest.approx(IK)


@pytest.mark.parametrize(
    ("phase", "distance"),
    # The retreat goes back along the approach axis, which points down here.
    [(Phase.LIFT, 0.05), (Phase.RETREAT, 0.1)],
)
def test_straight_phases_move_up_from_the_latched_pose(phase: Phase, distance: float) -> None:
    before = make_bench(phase)
    before.context.SetDiscreteState(np.r_[-1.0, np.eye(4).ravel()])
    assert not before.read("spatial_velocity").any()
    assert before.read("motion_done")[0] == 0.0

    bench = make_bench(phase, time=0.25)
    expected = straight_motion_twist(X_WG, X_WG, UP, distance, 0.25, StraightMotionConfig())
    assert bench.read("spatial_velocity") == pytest.approx(expected)
    assert bench.read("velocity") == pytest.approx(IK)


@pytest.mark.parametrize(
    ("phase", "changed", "output"),
    [
        (Phase.FOLLOW, {"field_velocity": np.full(6, np.nan)}, "spatial_velocity"),
        (Phase.APPROACH, {"position_measured": np.full(7, np.nan)}, "velocity"),
        (Phase.LIFT, {"gripper_pose": np.full(16, np.nan)}, "spatial_velocity"),
        (Phase.APPROACH, {"phase_start": np.nan}, "velocity"),
        (np.nan, {}, "velocity"),
        (np.nan, {}, "spatial_velocity"),
    ],
)
def test_nan_means_rest(phase: float, changed: dict, output: str) -> None:
    bench = make_bench(phase, time=0.25, **changed)

    assert not bench.read(output).any()
    assert bench.read("motion_done")[0] == 0.0


def test_a_nan_of_the_inverse_kinematics_passes_through() -> None:
    bench = make_bench(Phase.FOLLOW, ik_velocity=np.full(7, np.nan))

    assert np.isnan(bench.read("velocity")).all()


def test_direct_feedthrough_is_as_designed() -> None:
    dut = make_bench(Phase.WAIT).dut
    pairs = {
        (dut.get_input_port(i).get_name(), dut.get_output_port(o).get_name())
        for i in range(dut.num_input_ports())
        for o in range(dut.num_output_ports())
        if dut.HasDirectFeedthrough(i, o)
    }
    inputs = {
        "spatial_velocity": {"gripper_pose", "field_velocity"},
        "velocity": {"position_measured", "ik_velocity"},
        "motion_done": {"position_measured"},
    }
    assert pairs == {
        (name, output)
        for output, names in inputs.items()
        for name in names | {"phase", "phase_start"}
    }

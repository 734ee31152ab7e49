import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.control.field.straight_motion import straight_motion_twist
from poil_drake.robots.joint_trajectory import JointTrajectory, follow_joint_trajectory
from poil_drake.systems.control.motion_source import MotionSource, MotionSourceConfig
from poil_drake.systems.skill.phases import Phase

PERIOD = 1 / 256
CONFIG = MotionSourceConfig()
APPROACH = JointTrajectory([0.0, 1.0], [[0.0] * 7, [0.5] * 7], [[0.5] * 7] * 2)
DESCENT = JointTrajectory([0.0, 2.0], [[0.5] * 7, [0.7] * 7], [[0.1] * 7] * 2)
FIELD = np.arange(6.0) / 10
IK = np.arange(7.0) / 10
# Approaching straight down: the gripper's z axis is the world's -z.
X_WG = np.diag([1.0, -1.0, -1.0, 1.0])
X_WG[:3, 3] = [0.5, 0.0, 0.3]


@pytest.fixture
def dut() -> MotionSource:
    return MotionSource(approach=APPROACH, descent=DESCENT, config=CONFIG, period=PERIOD)


def context_of(dut: MotionSource, phase: Phase, time: float = 0.0, **changed):
    context = dut.CreateDefaultContext()
    values = {
        "phase": [phase],
        "phase_start": [0.0],
        "position_measured": np.full(7, 0.1),
        "gripper_pose": X_WG.ravel(),
        "field_velocity": FIELD,
        "ik_velocity": IK,
    } | changed
    for name, value in values.items():
        dut.GetInputPort(name).FixValue(context, value)
    Simulator(dut, context).AdvanceTo(time)
    return context


def evaluate(dut: MotionSource, context, name: str) -> np.ndarray:
    return dut.GetOutputPort(name).Eval(context)


@pytest.mark.parametrize(
    "phase", [Phase.WAIT, Phase.GRASP, Phase.RELEASE, Phase.SETTLE, Phase.DONE, Phase.FAULT]
)
def test_the_arm_rests_in_phases_without_motion(dut: MotionSource, phase: Phase) -> None:
    context = context_of(dut, phase, time=0.5)
    assert not evaluate(dut, context, "velocity").any()
    assert not evaluate(dut, context, "spatial_velocity").any()


@pytest.mark.parametrize(
    ("phase", "joints"), [(Phase.APPROACH, APPROACH), (Phase.DESCEND, DESCENT)]
)
def test_joint_phases_follow_their_trajectory(
    dut: MotionSource, phase: Phase, joints: JointTrajectory
) -> None:
    context = context_of(dut, phase, time=0.5)
    expected = follow_joint_trajectory(joints, 0.5, np.full(7, 0.1), CONFIG.joint_gain)
    assert evaluate(dut, context, "velocity") == pytest.approx(expected)
    assert evaluate(dut, context, "motion_done")[0] == 0.0
    there = {"position_measured": joints.positions[-1] + 0.019}
    ended = context_of(dut, phase, time=joints.duration, **there)
    assert evaluate(dut, ended, "motion_done")[0] == 1.0


def test_an_arm_that_was_held_up_has_not_ended_its_motion(dut: MotionSource) -> None:
    short = APPROACH.positions[-1] - 0.021 * np.eye(7)[2]
    context = context_of(dut, Phase.APPROACH, time=9.0, **{"position_measured": short})

    assert evaluate(dut, context, "motion_done")[0] == 0.0
    # It still makes for the end.
    assert evaluate(dut, context, "velocity")[2] == pytest.approx(0.021 * CONFIG.joint_gain)


def test_following_passes_the_field_and_the_inverse_kinematics(dut: MotionSource) -> None:
    context = context_of(dut, Phase.FOLLOW)
    assert evaluate(dut, context, "spatial_velocity") == pytest.approx(FIELD)
    assert evaluate(dut, context, "velocity") == pytest.approx(IK)


@pytest.mark.parametrize(
    ("phase", "direction", "distance"),
    [
        (Phase.LIFT, [0.0, 0.0, 1.0], CONFIG.lift_distance),
        # Back along the approach axis, which points down here.
        (Phase.RETREAT, [0.0, 0.0, 1.0], CONFIG.retreat_distance),
    ],
)
def test_straight_phases_move_from_the_latched_pose(
    dut: MotionSource, phase: Phase, direction: list[float], distance: float
) -> None:
    context = context_of(dut, phase, time=0.25)
    expected = straight_motion_twist(
        X_WG, X_WG, np.array(direction), distance, 0.25, CONFIG.straight
    )
    assert evaluate(dut, context, "spatial_velocity") == pytest.approx(expected)
    assert evaluate(dut, context, "velocity") == pytest.approx(IK)


def test_nothing_moves_straight_before_the_pose_is_latched(dut: MotionSource) -> None:
    context = context_of(dut, Phase.LIFT, time=0.0)
    context.SetDiscreteState(np.r_[-1.0, np.eye(4).ravel()])
    assert not evaluate(dut, context, "spatial_velocity").any()
    assert evaluate(dut, context, "motion_done")[0] == 0.0


@pytest.mark.parametrize(
    ("phase", "changed", "output"),
    [
        (Phase.FOLLOW, {"field_velocity": np.full(6, np.nan)}, "spatial_velocity"),
        (Phase.APPROACH, {"position_measured": np.full(7, np.nan)}, "velocity"),
        (Phase.LIFT, {"gripper_pose": np.full(16, np.nan)}, "spatial_velocity"),
    ],
)
def test_nan_means_rest(dut: MotionSource, phase: Phase, changed: dict, output: str) -> None:
    context = context_of(dut, phase, time=0.25, **changed)
    assert not evaluate(dut, context, output).any()


def test_an_answer_of_the_inverse_kinematics_that_is_none_goes_through(dut: MotionSource) -> None:
    context = context_of(dut, Phase.FOLLOW, ik_velocity=np.full(7, np.nan))

    assert np.isnan(dut.GetOutputPort("velocity").Eval(context)).all()


def test_with_a_phase_of_nan_nothing_moves_and_nothing_ends(dut: MotionSource) -> None:
    context = context_of(dut, Phase.FOLLOW)
    dut.GetInputPort("phase").FixValue(context, [np.nan])
    Simulator(dut, context).AdvanceTo(0.25)

    assert not evaluate(dut, context, "spatial_velocity").any()
    assert not evaluate(dut, context, "velocity").any()
    assert evaluate(dut, context, "motion_done")[0] == 0.0


def test_with_an_unknown_start_of_the_phase_the_arm_rests(dut: MotionSource) -> None:
    context = context_of(dut, Phase.APPROACH, phase_start=[np.nan])

    assert not evaluate(dut, context, "velocity").any()
    assert evaluate(dut, context, "motion_done")[0] == 0.0


def test_direct_feedthrough_is_as_designed(dut: MotionSource) -> None:
    pairs = {
        (dut.get_input_port(i).get_name(), dut.get_output_port(o).get_name())
        for i in range(dut.num_input_ports())
        for o in range(dut.num_output_ports())
        if dut.HasDirectFeedthrough(i, o)
    }
    by_phase = {"phase", "phase_start"}
    assert pairs == {
        *((name, "spatial_velocity") for name in by_phase | {"gripper_pose", "field_velocity"}),
        *((name, "velocity") for name in by_phase | {"position_measured", "ik_velocity"}),
        *((name, "motion_done") for name in by_phase | {"position_measured"}),
    }

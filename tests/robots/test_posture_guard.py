import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.robots import posture_guard as dut
from poil_drake.robots.collision import CollisionConfig, RobotCollisionChecker
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_hand import GripperGeometry
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.robots.posture_guard import PostureRule

MODEL = PandaModel()
UPRIGHT = np.zeros(7)
# All joints at zero, the arm stands up and the gripper hangs down from the wrist. From the Panda's
# measures: x = 0.088, z = 0.333 + 0.316 + 0.384 - 0.107 - 0.1034.
UPRIGHT_GRIPPER = np.array([0.088, 0.0, 0.8226])
TIP_END = GripperGeometry().tip_end
SPHERES = make_robot_spheres(finger_opening=None)
FOLDED = np.array([0.0, -1.0, 0.0, -3.0, 0.0, 0.2, 0.0])
"""The hand is bent back upon the shoulder."""
LOW = np.array([0.0, 0.5, 0.0, -2.2, 0.0, 2.7, np.pi / 4])
"""The hand hangs straight down in front of the arm, as 0.5 + 2.2 - 2.7 = 0, lower than the rest."""


def guard(*, model: PandaModel = MODEL, **changes) -> dut.PostureGuard:
    return dut.PostureGuard(model=model, config=dut.PostureGuardConfig(**changes))


def clearance(rule: PostureRule, q: np.ndarray, **changes) -> float:
    return guard(**changes).clearances(q[None])[0, rule]


def raised(q: np.ndarray, angle: float) -> np.ndarray:
    """Returns a posture with the shoulder turned back, which lifts a hand in front of it [rad]."""
    return q - angle * np.eye(7)[1]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", ["lower", "upper"])
def test_the_gripper_point_keeps_the_box(axis: int, side: str) -> None:
    sign = 1.0 if side == "upper" else -1.0
    face = np.full(3, 2.0 * sign)
    face[axis] = UPRIGHT_GRIPPER[axis] + 0.03 * sign
    box = {"gripper_lower": (-2.0,) * 3, "gripper_upper": (2.0,) * 3}
    box |= {"body_lower": (-2.0,) * 3, "body_upper": (2.0,) * 3, f"gripper_{side}": tuple(face)}

    assert clearance(PostureRule.WORKSPACE, UPRIGHT, **box) == pytest.approx(0.03, abs=1e-9)


def test_the_box_moves_with_the_base_of_the_robot() -> None:
    X_WB = np.eye(4)
    X_WB[:3, 3] = [1.0, -3.0, 0.5]
    moved = guard(model=PandaModel(X_WB=X_WB), gripper_upper=(0.85, 0.85, 0.9))

    # The gripper is 0.0774 m below the top, with the base as without.
    here = clearance(PostureRule.WORKSPACE, UPRIGHT, gripper_upper=(0.85, 0.85, 0.9))

    assert here == pytest.approx(0.9 - UPRIGHT_GRIPPER[2])
    assert moved.clearances(UPRIGHT[None])[0, PostureRule.WORKSPACE] == pytest.approx(here)


def test_the_whole_arm_keeps_the_larger_box() -> None:
    # The wrist is the highest part of the upright arm; its spheres reach beyond its centre.
    heights = SPHERES.world_centers(MODEL.link_poses(UPRIGHT))[:, 2] + SPHERES.radii
    top = heights[SPHERES.links < 8].max()

    found = clearance(PostureRule.WORKSPACE, UPRIGHT, body_upper=(1.1, 1.1, top + 0.01))

    assert found == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("distance", "said"),
    [(0.012, "12.0 mm from {face}, 0.8346 m"), (-0.012, "12.0 mm beyond {face}, 0.8106 m")],
)
def test_the_nearest_face_over_all_postures_is_named(distance: float, said: str) -> None:
    dut = guard(gripper_upper=(0.85, 0.85, UPRIGHT_GRIPPER[2] + distance))
    lowered = UPRIGHT + 0.5 * np.eye(7)[1]

    said = f"the gripper is {said}".format(face="poil.safety.posture.gripper_upper[2]")
    assert dut.tightest_face(np.array([lowered, UPRIGHT])).startswith(said)
    assert dut.tightest(UPRIGHT).startswith(said)


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=10)
def test_the_nearest_of_all_faces_is_the_first_rule(seed: int) -> None:
    q = np.random.default_rng(seed).uniform(MODEL.lower, MODEL.upper, (5, 7))
    dut = guard()

    distances = dut.face_distances(q)

    assert distances.shape == (5, 12)
    clearances = dut.clearances(q)
    np.testing.assert_array_equal(distances.min(axis=1), clearances[:, PostureRule.WORKSPACE])
    one_by_one = np.concatenate([dut.clearances(one[None]) for one in q])
    np.testing.assert_allclose(clearances, one_by_one, atol=1e-12)


def test_closed_finger_tips_keep_off_the_table() -> None:
    height = MODEL.gripper_pose(LOW)[2, 3] - TIP_END - 0.05

    found = clearance(PostureRule.TABLE, LOW, table_height=height, table_margin=0.01)

    assert found == pytest.approx(0.05 - 0.01)


def test_the_elbow_keeps_off_the_table() -> None:
    # Lying forward, the arm is lowest at its spheres; the hand, bent up, is higher.
    q = np.array([0.0, 1.7, 0.0, -0.3, 0.0, 3.5, 0.0])
    lows = SPHERES.world_centers(MODEL.link_poses(q))[:, 2] - SPHERES.radii
    lowest = lows[(SPHERES.links >= 2) & (SPHERES.links < 8)].min()

    found = clearance(PostureRule.TABLE, q, table_height=0.1, table_margin=0.0)

    assert found == pytest.approx(lowest - 0.1)


def test_without_a_table_nothing_is_too_low() -> None:
    assert clearance(PostureRule.TABLE, UPRIGHT, table_height=None) == np.inf


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=20)
def test_distance_to_itself_is_that_of_the_planners_check(seed: int) -> None:
    q = np.random.default_rng(seed).uniform(MODEL.lower, MODEL.upper, size=(20, 7))
    checker = RobotCollisionChecker(
        model=MODEL,
        spheres=SPHERES,
        scene=SceneCloud(np.zeros((0, 3))),
        config=CollisionConfig(max_distance=1.0),
    )
    expected = checker.self_clearance(MODEL.link_poses(q)) - 0.004

    found = guard(self_margin=0.004).clearances(q)[:, PostureRule.SELF_COLLISION]

    np.testing.assert_allclose(found, np.minimum(expected, 0.05), atol=1e-12)


@pytest.mark.parametrize(
    ("q", "changes", "rule"),
    [
        (LOW, {}, None),
        (LOW, {"gripper_upper": (0.5, 0.85, 1.2)}, PostureRule.WORKSPACE),
        (LOW, {"table_height": 0.05}, PostureRule.TABLE),
        (FOLDED, {}, PostureRule.SELF_COLLISION),
        # Of several the first.
        (LOW, {"gripper_upper": (0.5, 0.85, 1.2), "table_height": 0.05}, PostureRule.WORKSPACE),
    ],
)
def test_the_first_broken_rule_is_returned(q: np.ndarray, changes: dict, rule) -> None:
    # The ready posture is far from everything: at x = 0.31, 0.49 m high.
    free = np.array(NOMINAL_POSTURE)

    assert guard(**changes).broken_rule(np.stack([free, q, free]), free) == rule


def test_an_arm_that_is_too_low_may_only_rise() -> None:
    height = MODEL.gripper_pose(LOW)[2, 3]  # The tips are 8.8 mm and the margin too low.
    table = guard(table_height=height)

    assert table.broken_rule(raised(LOW, 0.01)[None], LOW) is None
    assert table.broken_rule(raised(LOW, -0.01)[None], LOW) is PostureRule.TABLE
    assert table.broken_rule(LOW[None], LOW) is None  # It may stay.


def test_an_arm_that_breaks_one_rule_must_keep_the_others() -> None:
    height = MODEL.gripper_pose(LOW)[2, 3]
    # Too low, and just below the top of the box.
    cage = guard(table_height=height, gripper_upper=(0.85, 0.85, height + 1e-4))

    assert cage.broken_rule(raised(LOW, 0.01)[None], LOW) is PostureRule.WORKSPACE


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"gripper_lower": (0.0, 0.0, 2.0)}, "gripper_lower"),
        ({"body_upper": (1.0, 1.0)}, "body_upper"),
        ({"body_upper": (1.0, 1.0, np.nan)}, "body_upper"),
        ({"table_height": np.inf}, "table_height"),
        ({"table_margin": np.nan}, "table_margin"),
        ({"self_margin": -np.inf}, "self_margin"),
    ],
)
def test_settings_are_checked(changes: dict, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        guard(**changes)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-3, 0.1, 1.0]))
@settings(derandomize=True, max_examples=20)
def test_no_clearance_changes_by_more_than_the_largest_displacement(seed, size) -> None:
    rng = np.random.default_rng(seed)
    dut = guard()
    q = rng.uniform(MODEL.lower, MODEL.upper, (50, 7))
    turns = size * rng.normal(size=q.shape)

    changes = np.abs(dut.clearances(q + turns) - dut.clearances(q)).max(axis=1)

    bounds = np.array([dut.largest_displacement(turn[None]) for turn in turns])
    assert (changes <= bounds).all()
    assert (changes > 0.02 * bounds).any()
    assert dut.largest_displacement(turns) == pytest.approx(bounds.max())

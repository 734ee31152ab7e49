import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from poil_drake.errors import InvalidValueError
from poil_drake.planning.joint_timing import ACCELERATION_SCALE, VELOCITY_SCALE, time_joint_path
from poil_drake.robots.panda import ACCELERATION_LIMITS

SPEEDS = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])


def bent_path(seed: int, count: int = 30) -> np.ndarray:
    """A smooth random path (count, 7)."""
    rng = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, count)[:, None]
    turn, bend = rng.uniform(-1.0, 1.0, (2, 7))
    return share * turn + 0.3 * bend * np.sin(np.pi * share)


@settings(max_examples=15)
@given(st.integers(0, 1000))
def test_motion_is_from_rest_to_rest_within_the_limits(seed: int):
    path = bent_path(seed)

    dut = time_joint_path(path, SPEEDS)

    assert_allclose(dut.positions[[0, -1]], path[[0, -1]], atol=1e-9)
    assert_allclose(dut.velocities[[0, -1]], 0.0)
    # 5 % for the path's speed being bounded at samples only.
    assert np.all(np.abs(dut.velocities) <= 1.05 * VELOCITY_SCALE * SPEEDS)
    acceleration = np.diff(dut.velocities, axis=0) / np.diff(dut.times)[:, None]
    limits = ACCELERATION_SCALE * np.array(ACCELERATION_LIMITS)
    assert np.all(np.abs(acceleration) <= 1.05 * limits)


def test_velocities_are_those_of_the_positions():
    dut = time_joint_path(bent_path(2), SPEEDS)

    differences = np.gradient(dut.positions, dut.times, axis=0)
    assert_allclose(differences[2:-2], dut.velocities[2:-2], atol=0.01)


def test_motion_stays_on_the_path():
    path = bent_path(3, count=200)

    dut = time_joint_path(path, SPEEDS)

    gaps = np.linalg.norm(dut.positions[:, None] - path, axis=-1).min(axis=1)
    assert gaps.max() < 0.01


def test_motion_takes_at_least_the_shortest_duration():
    assert time_joint_path(bent_path(4), SPEEDS, min_duration=9.0).duration >= 9.0


def test_long_straight_motion_reaches_the_allowed_speed():
    path = np.linspace(0.0, 2.0, 50)[:, None] * np.eye(7)[0]

    dut = time_joint_path(path, SPEEDS)

    assert_allclose(np.abs(dut.velocities).max(), VELOCITY_SCALE * SPEEDS[0], rtol=0.02)


def test_path_that_does_not_move_is_rejected():
    with pytest.raises(InvalidValueError, match="equal to the one before"):
        time_joint_path(np.zeros((3, 7)), SPEEDS)

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poil_drake.control.field.straight_motion import (
    StraightMotionConfig,
    straight_motion_duration,
    straight_motion_twist,
    trapezoid,
)

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("elapsed", "covered", "speed"),
    # 0.1 m at 0.1 m/s and 0.4 m/s^2: ramps of 0.25 s cover 12.5 mm each, cruise of 0.75 s.
    [
        (0.0, 0.0, 0.0),
        (0.25, 0.0125, 0.1),
        (0.625, 0.05, 0.1),
        (1.0, 0.0875, 0.1),
        (1.25, 0.1, 0.0),
        (9.0, 0.1, 0.0),
    ],
)
def test_trapezoid_by_hand(elapsed: float, covered: float, speed: float) -> None:
    assert trapezoid(0.1, elapsed, 0.1, 0.4) == pytest.approx((covered, speed, 1.25))


@given(
    distance=st.floats(0.0, 1.0),
    speed=st.floats(0.01, 1.0),
    acceleration=st.floats(0.05, 5.0),
    part=st.floats(0.01, 0.99),
)
def test_trapezoid_speed_is_the_derivative_of_the_distance(
    distance: float, speed: float, acceleration: float, part: float
) -> None:
    *_, total = trapezoid(distance, 0.0, speed, acceleration)
    h = 1e-6
    t = part * total
    before, after = (trapezoid(distance, t + s * h, speed, acceleration)[0] for s in (-1, 1))
    # Central difference: the error is at most acceleration * h at a corner of the profile.
    now = trapezoid(distance, t, speed, acceleration)[1]
    assert (after - before) / (2 * h) == pytest.approx(now, abs=2 * acceleration * h + 1e-6)
    assert now <= speed * (1 + 1e-9)


def test_twist_on_track_is_pure_feedforward() -> None:
    X = np.eye(4)
    X[2, 3] = 0.05
    twist = straight_motion_twist(
        np.eye(4), X, UP, 0.1, 0.625, StraightMotionConfig(speed=0.1, acceleration=0.4)
    )
    assert twist == pytest.approx([0, 0, 0, 0, 0, 0.1])


def test_twist_pulls_back_position_and_orientation() -> None:
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, 0.0, 0.2]).as_matrix()
    X[0, 3] = 0.01
    twist = straight_motion_twist(np.eye(4), X, UP, 0.0, 1.0, StraightMotionConfig(gain=5.0))
    assert twist == pytest.approx([0, 0, -1.0, -0.05, 0, 0])


def test_duration_by_hand() -> None:
    config = StraightMotionConfig(speed=0.1, acceleration=0.4)
    assert straight_motion_duration(0.1, config) == pytest.approx(1.25)
    assert straight_motion_duration(0.0, config) == 0.0

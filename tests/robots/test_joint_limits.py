import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.robots.joint_limits import JointLimits


@pytest.fixture
def dut() -> JointLimits:
    return JointLimits(
        lower=np.array([-2.0, -1.0]),
        upper=np.array([2.0, 1.0]),
        velocity=np.array([1.0, 3.0]),
        acceleration=np.array([5.0, 6.0]),
    )


def test_far_from_its_limits_a_joint_may_be_fast(dut: JointLimits) -> None:
    lowest, highest = dut.velocity_bounds(np.zeros(2), margin=0.1, braking_gain=5.0)

    np.testing.assert_array_equal(lowest, [-1.0, -3.0])
    np.testing.assert_array_equal(highest, [1.0, 3.0])


def test_near_a_limit_the_speed_is_the_gain_times_the_distance(dut: JointLimits) -> None:
    lowest, highest = dut.velocity_bounds(np.array([1.8, -0.7]), margin=0.1, braking_gain=5.0)

    np.testing.assert_allclose(highest, [0.5, 3.0])
    np.testing.assert_allclose(lowest, [-1.0, -1.0])


def test_beyond_the_margin_there_is_only_a_way_back(dut: JointLimits) -> None:
    lowest, highest = dut.velocity_bounds(np.array([1.95, -1.5]), margin=0.1, braking_gain=5.0)

    np.testing.assert_array_equal(highest, [0.0, 3.0])
    np.testing.assert_array_equal(lowest, [-1.0, 0.0])


def test_limits_without_room_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="no room"):
        JointLimits(
            lower=np.array([1.0]),
            upper=np.array([1.0]),
            velocity=np.ones(1),
            acceleration=np.ones(1),
        )


def test_limits_of_different_sizes_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"JointLimits\.velocity"):
        JointLimits(
            lower=-np.ones(2), upper=np.ones(2), velocity=np.ones(3), acceleration=np.ones(2)
        )

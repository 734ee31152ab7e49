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


@pytest.mark.parametrize(
    ("positions", "lowest", "highest"),
    [
        ([0.0, 0.0], [-1.0, -3.0], [1.0, 3.0]),  # Far from the limits.
        ([1.8, -0.7], [-1.0, -1.0], [0.5, 3.0]),  # 0.1 and 0.2 from the margin, times 5 / s.
        ([1.95, -1.5], [-1.0, 0.0], [0.0, 3.0]),  # Beyond it there is only the way back.
    ],
)
def test_velocity_bounds_shrink_towards_the_limits(
    dut: JointLimits, positions: list, lowest: list, highest: list
) -> None:
    bounds = dut.velocity_bounds(np.array(positions), margin=0.1, braking_gain=5.0)

    np.testing.assert_allclose(bounds, [lowest, highest], atol=1e-12)


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

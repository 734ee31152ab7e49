import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.robots.joint_limits import JointLimits

LIMITS = {
    "lower": np.array([-2.0, -1.0]),
    "upper": np.array([2.0, 1.0]),
    "velocity": np.array([1.0, 3.0]),
    "acceleration": np.array([5.0, 6.0]),
}


@pytest.mark.parametrize(
    ("positions", "lowest", "highest"),
    [
        ([0.0, 0.0], [-1.0, -3.0], [1.0, 3.0]),  # Far from the limits.
        ([1.8, -0.7], [-1.0, -1.0], [0.5, 3.0]),  # 0.1 and 0.2 from the margin, times 5 / s.
        ([1.95, -1.5], [-1.0, 0.0], [0.0, 3.0]),  # Beyond it there is only the way back.
    ],
)
def test_velocity_bounds_shrink_towards_the_limits(
    positions: list, lowest: list, highest: list
) -> None:
    dut = JointLimits(**LIMITS)

    bounds = dut.velocity_bounds(np.array(positions), margin=0.1, braking_gain=5.0)

    np.testing.assert_allclose(bounds, [lowest, highest], atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"lower": LIMITS["upper"]}, "no room"), ({"velocity": np.ones(3)}, "JointLimits.velocity")],
)
def test_limits_without_room_or_of_different_sizes_are_refused(changes: dict, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        JointLimits(**LIMITS | changes)

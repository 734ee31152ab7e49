import numpy as np
import pytest

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError

START = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
TURNED = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])


def make_trajectory(**changed) -> PointTrajectory:
    values = {
        "times": np.array([0.0, 1.0, 3.0]),
        "positions": np.stack([START, TURNED, TURNED]),
        "velocities": np.zeros((3, 2, 3)),
    }
    return PointTrajectory(**(values | changed))


@pytest.mark.parametrize(
    ("time", "second_point"),
    [
        (-1.0, [1.0, 0.0, 0.0]),
        (0.0, [1.0, 0.0, 0.0]),
        (0.25, [0.75, 0.5, 0.0]),
        (1.0, [0.0, 2.0, 0.0]),
        (2.0, [0.0, 2.0, 0.0]),
        (3.0, [0.0, 2.0, 0.0]),
        (9.0, [0.0, 2.0, 0.0]),
    ],
)
def test_positions_are_linear_between_samples_and_clamped_outside(
    time: float, second_point: list[float]
) -> None:
    positions = make_trajectory().positions_at(time)

    np.testing.assert_allclose(positions, [[0.0, 0.0, 0.0], second_point], atol=1e-15)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("times", np.array([0.0, 1.0, 1.0]), "two times that increase from 0"),
        ("times", np.array([0.5, 1.0, 3.0]), "two times that increase from 0"),
        ("positions", np.zeros((2, 2, 3)), r"positions has shape \(2, 2, 3\)"),
        ("positions", np.full((3, 2, 3), np.nan), "not finite"),
        ("velocities", np.zeros((3, 3, 3)), r"velocities has shape \(3, 3, 3\)"),
        ("velocities", np.ones((3, 2, 3)), "last sample .* not zero"),
    ],
)
def test_invalid_trajectories_are_rejected(field: str, value: np.ndarray, says: str) -> None:
    with pytest.raises(InvalidValueError, match=says):
        make_trajectory(**{field: value})

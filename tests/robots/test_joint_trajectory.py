import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.robots.joint_trajectory import JointTrajectory


@pytest.fixture
def dut() -> JointTrajectory:
    return JointTrajectory([0.0, 1.0, 3.0], [[0.0], [2.0], [2.0]], [[2.0], [1.0], [0.0]])


@pytest.mark.parametrize(
    ("time", "position", "velocity"),
    [(-1.0, 0.0, 0.0), (0.5, 1.0, 1.5), (2.0, 2.0, 0.5), (3.0, 2.0, 0.0), (9.0, 2.0, 0.0)],
)
def test_samples_are_linear_and_rest_outside(
    dut: JointTrajectory, time: float, position: float, velocity: float
) -> None:
    q, qd = dut.sample(time)
    assert q == pytest.approx([position])
    assert qd == pytest.approx([velocity])


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0], [1.0, 2.0]])
def test_times_must_increase_from_zero(times: list[float]) -> None:
    rows = np.zeros((len(times), 1))
    with pytest.raises(InvalidValueError, match="times"):
        JointTrajectory(times, rows, rows)

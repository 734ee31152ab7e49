import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poil_drake.systems.propagation.motion_history import empty_history, motion_at, record_motion

PERIOD = 1 / 256


def turn_about_z(angle: float, x: float = 0.0) -> np.ndarray:
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    X[0, 3] = x
    return X


def filled(count: int, duration: float = 0.1) -> np.ndarray:
    history = empty_history(duration, PERIOD)
    for tick in range(count):
        record_motion(history, tick * PERIOD, turn_about_z(0.01 * tick, 0.1 * tick), PERIOD)
    return history


def test_it_reaches_back_over_its_duration_and_no_farther() -> None:
    history = filled(100, duration=0.1)

    assert motion_at(history, 99 * PERIOD - 0.1, PERIOD) is not None
    assert motion_at(history, 60 * PERIOD, PERIOD) is None


def test_the_future_and_an_empty_history_are_unknown() -> None:
    assert motion_at(filled(10), 10 * PERIOD, PERIOD) is None
    assert motion_at(filled(10), -PERIOD, PERIOD) is None
    assert motion_at(empty_history(0.1, PERIOD), 0.0, PERIOD) is None


def test_between_samples_the_motion_is_interpolated() -> None:
    history = filled(100)

    X = motion_at(history, 95.25 * PERIOD, PERIOD)

    np.testing.assert_allclose(X, turn_about_z(0.9525, 9.525), atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 1e-13, -1e-13])
def test_a_sample_is_returned_exactly(error: float) -> None:
    X = motion_at(filled(100), 95 * PERIOD + error, PERIOD)

    np.testing.assert_array_equal(X, turn_about_z(0.01 * 95, 0.1 * 95))

import numpy as np
import pytest

from poil_drake.control.reference.make_reference import ReferenceConfig
from poil_drake.control.reference.recorded_reference import reference_from_samples as dut
from poil_drake.errors import InvalidValueError

BODY = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])


def stretching(rest=16):
    """Rests, moves along x by 0.2 m in 2 s while it is stretched along y, and rests."""
    share = np.concatenate([np.zeros(rest), np.linspace(0.0, 1.0, 33), np.ones(rest)])
    positions = BODY * (1.0 + share[:, None, None] * [0.0, 0.2, 0.0])
    positions = positions + share[:, None, None] * np.array([0.2, 0.0, 0.0])
    return np.arange(len(share)) / 16, positions


def test_deformation_is_kept():
    times, positions = stretching()

    reference = dut(times, positions)

    np.testing.assert_allclose(reference.positions[-1], positions[-1])
    middle = reference.positions_at(reference.times[-1] / 2)
    assert middle[2, 1] == pytest.approx(0.11, abs=0.002)


def test_rest_before_and_after_is_cut():
    reference = dut(*stretching(rest=40))

    assert reference.times[-1] == pytest.approx(2.0, abs=0.2)


def test_velocities_are_those_of_the_motion_and_zero_at_the_end():
    reference = dut(*stretching())

    k = len(reference.times) // 2
    np.testing.assert_allclose(reference.velocities[k, 0], [0.1, 0.0, 0.0], atol=1e-3)
    assert not reference.velocities[-1].any()


def test_sample_period_can_be_set():
    reference = dut(*stretching(), ReferenceConfig(sample_period=0.01))

    np.testing.assert_allclose(np.diff(reference.times), 0.01, rtol=0.05)


def test_unobserved_points_are_rejected():
    times, positions = stretching()
    positions[3, 2] = np.nan

    with pytest.raises(InvalidValueError, match="positions"):
        dut(times, positions)

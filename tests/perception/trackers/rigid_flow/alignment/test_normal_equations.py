import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    huber_weights,
    tukey_weights,
)


def test_solves_weighted_least_squares():
    rng = np.random.default_rng(0)
    J, r, w = rng.normal(size=(40, 6)), rng.normal(size=40), rng.uniform(0.1, 2.0, 40)
    dut = NormalEquations()

    dut.add(J[:15], r[:15], w[:15])
    dut.add(J[15:], r[15:], w[15:])

    root = np.sqrt(w)
    expected = np.linalg.lstsq(J * root[:, None], r * root, rcond=None)[0]
    np.testing.assert_allclose(np.linalg.solve(dut.H, dut.b), expected, atol=1e-12)


def test_information_excludes_the_spurious_part():
    dut = NormalEquations()
    dut.add(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), np.zeros(6), np.ones(6))
    dut.add_spurious(np.diag([2.0, 1.0, 0.0, 0.0, 0.0, 0.0]), np.ones(6))

    # 1 - 4 is below zero, 4 - 1 remains, the rest is unchanged.
    np.testing.assert_allclose(dut.information(0.1), np.diag([0.0, 3.0, 9.0, 16.0, 25.0, 36.0]))


@given(st.floats(-3.0, 3.0))
def test_tukey_s_weights(r):
    (weight,) = tukey_weights(np.array([r]), 2.0)

    assert weight == pytest.approx((1.0 - r * r / 4.0) ** 2 if abs(r) < 2.0 else 0.0)


@given(st.floats(-3.0, 3.0))
def test_huber_s_weights(r):
    (weight,) = huber_weights(np.array([r]), 1.5)

    assert weight == pytest.approx(1.0 if abs(r) <= 1.5 else 1.5 / abs(r))

import numpy as np
import pytest

from poil_drake.geometry.centred_sums import centred_sums as dut


@pytest.mark.parametrize("weights", [None, np.array([1.0, 0.2, 0.7, 0.0, 0.4])])
@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_sums_are_those_about_the_weighted_means(weights, offset):
    x, v, y = np.random.default_rng(0).normal(scale=0.03, size=(3, 5, 3))
    w = np.ones(5) if weights is None else weights
    centred = [a - w @ a / w.sum() for a in (x, v, y)]

    sums = dut((x + offset, v, y - offset), weights)

    # Places 1 km away are rounded to 1e-13 m.
    tolerance = 1e-16 if offset == 0.0 else 1e-12
    assert sums.total == pytest.approx(w.sum())
    np.testing.assert_allclose(sums.mean[3:6], w @ v / w.sum(), atol=1e-16)
    np.testing.assert_allclose(sums.centred, np.hstack(centred), atol=tolerance)
    expected = (centred[0].T * w) @ np.hstack(centred)
    np.testing.assert_allclose(sums.sums, expected, atol=tolerance)


def test_combined_vectors_are_products_with_the_factors():
    x, v, y = np.random.default_rng(1).normal(size=(3, 4, 3))
    F, G = np.random.default_rng(2).normal(size=(2, 3, 3))
    sums = dut((x, v, y))

    squares = sums.combine((*F.ravel().tolist(), *G.ravel().tolist()))

    expected = (x - x.mean(axis=0)) @ F + (v - v.mean(axis=0)) @ G
    np.testing.assert_allclose(squares, np.sum(expected**2, axis=1))

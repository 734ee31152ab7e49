import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from poil_drake.control.field.triangle_twists import triangle_twist_squares as dut
from poil_drake.control.field.twist_fit import fit_twist
from poil_drake.geometry.triples import choose_triples


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=50)
def test_residuals_are_those_of_the_twist_fitted_to_each_triangle(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(scale=0.03, size=(6, 3)) + rng.normal(size=3)
    velocities = rng.normal(size=(6, 3))
    triples = choose_triples(points)

    squares = dut(points, velocities, triples)

    assert squares.shape == (6, len(triples))
    for triple, found in zip(triples, squares.T, strict=True):
        omega, v, *_ = fit_twist(points[triple], velocities[triple])[0]
        arms = points - points[triple].mean(axis=0)
        left = v + np.cross(omega, arms) - velocities
        np.testing.assert_allclose(found, np.sum(left**2, axis=1), rtol=1e-6, atol=1e-9)

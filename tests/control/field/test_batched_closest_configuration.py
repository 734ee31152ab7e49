import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_references import still_reference

from poil_drake.control.field.batched_closest_configuration import closest_configurations as dut
from poil_drake.control.field.closest_configuration import closest_configuration

SAMPLES, COUNT = 30, 5


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1.0, 1000.0]))
@settings(derandomize=True, max_examples=50)
def test_result_is_that_of_single_states_at_any_distance_from_the_origin(seed, distance):
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(scale=0.01, size=(SAMPLES, COUNT, 3)), axis=0) + distance
    # Some samples stand still, and the second half of the rest comes back.
    positions[5:9] = positions[9]
    positions[20:] = positions[19:9:-1]
    points = positions[rng.integers(SAMPLES, size=40)] + rng.normal(scale=0.02, size=(40, COUNT, 3))
    points[:20] = positions[:20]
    weights = rng.uniform(0.1, 1.0, size=(40, COUNT))

    reference = still_reference(positions)

    segments, fractions = dut(points, reference, weights, interpolate=True)

    for b in range(40):
        segment, fraction = closest_configuration(
            points[b], reference, weights[b], interpolate=True
        )
        assert segments[b] + fractions[b] == pytest.approx(segment + fraction, abs=1e-9)


def test_interpolation_is_optional():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    reference = still_reference(corners + np.arange(6.0)[:, None, None] * [1.0, 0, 0])
    points = corners + np.array([[2.75, 0.3, 0.0], [9.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])[:, None]

    between = dut(points, reference, np.ones((3, 3)), interpolate=True)
    at_samples = dut(points, reference, np.ones((3, 3)), interpolate=False)

    np.testing.assert_allclose(np.add(*between), [2.75, 5.0, 0.0])
    np.testing.assert_array_equal(np.add(*at_samples), [3.0, 5.0, 0.0])

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_references import still_reference

from poil_drake.control.field.closest_configuration import closest_configuration, squared_distances
from poil_drake.control.field.sample_features import SampleFeatures

SAMPLES, COUNT = 40, 5
property_test = settings(derandomize=True, max_examples=100)
seeds = st.integers(0, 2**32 - 1)
distances = st.sampled_from([0.0, 1.0, 1000.0])
steps = st.sampled_from([1e-5, 0.01, 10.0])


def wandering_positions(rng, distance, step=0.01):
    """A random walk with a pause, whose second half returns over the same samples."""
    positions = np.cumsum(rng.normal(scale=step, size=(SAMPLES, COUNT, 3)), axis=0) + distance
    positions[5:9] = positions[9]
    positions[SAMPLES // 2 :] = positions[SAMPLES // 2 - 1 :: -1]
    return positions


def some_weights(rng):
    """None, all alike, or uneven, and some of them zero."""
    uneven = rng.uniform(0.1, 1.0, size=COUNT) * (rng.random(COUNT) < 0.7)
    return [None, np.full(COUNT, 0.7), uneven + np.eye(COUNT)[0]][rng.integers(3)]


@given(seeds, distances, distances, steps)
@property_test
def test_costs_are_half_the_squared_distances_up_to_a_constant_and_the_tolerance(
    seed, points_distance, distance, step
):
    rng = np.random.default_rng(seed)
    positions = wandering_positions(rng, distance, step)
    # Some samples are in the middle, where they are small next to the others.
    positions[:2] = positions.mean(axis=(0, 1))
    points = rng.normal(scale=1e-3, size=(COUNT, 3)) + points_distance
    weights = some_weights(rng)

    costs, tolerance = SampleFeatures.of(positions).relative_costs(points, weights)

    # Long doubles have three digits more than the costs.
    exact = positions.astype(np.longdouble) - points
    w = np.ones(COUNT) if weights is None else weights
    squares = np.einsum("tnk,tnk,n->t", exact, exact, w.astype(np.longdouble))
    assert np.ptp(costs - 0.5 * squares) <= tolerance
    if max(points_distance, distance) <= 1.0 and step <= 0.01:
        assert tolerance < 1e-12


@given(seeds, distances, steps)
@property_test
def test_the_closest_sample_is_the_last_with_the_least_squared_distance(seed, distance, step):
    rng = np.random.default_rng(seed)
    positions = wandering_positions(rng, distance, step)
    off = rng.choice([0.0, 1e-9, 0.01, 0.3])
    points = positions[rng.integers(SAMPLES)] + rng.normal(scale=off, size=(COUNT, 3))
    weights = some_weights(rng)
    squares = squared_distances(points, positions, weights)

    index, _ = closest_configuration(points, still_reference(positions), weights, interpolate=False)

    assert index == np.flatnonzero(squares == squares.min())[-1]


@pytest.mark.parametrize("size", [1e200, 1e307])
def test_if_costs_overflow_squared_distances_decide(size):
    positions = np.stack([50.0 * np.eye(3), 50.0 * np.eye(3) + 1.0])

    with np.errstate(over="ignore", invalid="ignore"):
        index, _ = closest_configuration(
            np.full((3, 3), size), still_reference(positions), interpolate=False
        )

    assert index == 1


@given(seeds)
@property_test
def test_exactly_equal_samples_are_equal_in_spite_of_rounding(seed):
    # Multiples of 1 / 1024 m, so that differences and their squares are exact.
    rng = np.random.default_rng(seed)
    points = rng.integers(-100, 100, size=(COUNT, 3)) / 1024.0
    off = rng.integers(1, 10, size=(1, COUNT, 3)) / 1024.0
    others = rng.integers(20, 60, size=(5, COUNT, 3)) / 1024.0
    order = rng.permutation(8)
    positions = (points + np.concatenate([off, -off, off * [1, -1, 1], others]))[order]

    index, _ = closest_configuration(points, still_reference(positions), interpolate=False)

    assert index == np.flatnonzero(order < 3)[-1]


def test_samples_with_indistinguishable_costs_are_compared_by_weight():
    # 1 km away the bound on the rounding of costs is some 0.2 mm^2.
    points = np.eye(3) + 1000.0
    positions = np.stack([points, points])
    positions[0, 0, 2] += 1e-4
    positions[1, 1, 2] += 0.9e-4
    weights = np.array([0.1, 1.0, 1.0])
    costs, tolerance = SampleFeatures.of(positions).relative_costs(points, weights)
    assert np.ptp(costs) < tolerance

    index, _ = closest_configuration(points, still_reference(positions), weights, interpolate=False)

    assert index == 0


def test_points_without_weight_are_ignored():
    rng = np.random.default_rng(0)
    positions = wandering_positions(rng, 0.0)
    points = positions[12] + rng.normal(scale=0.005, size=(COUNT, 3))
    weights = np.array([1.0, 0.5, 0.8, 1.0, 0.0])
    expected = closest_configuration(
        points[:4], still_reference(positions[:, :4]), weights[:4], interpolate=True
    )
    points[4] += 100.0

    found = closest_configuration(points, still_reference(positions), weights, interpolate=True)

    assert sum(found) == pytest.approx(sum(expected), abs=1e-9)


def test_cached_arrays_are_read_only_and_not_pickled():
    reference = still_reference(wandering_positions(np.random.default_rng(2), 0.0))
    plain = len(pickle.dumps(reference))

    cached = [reference.states, reference.state_steps]
    cached += [v for v in vars(reference.features).values() if isinstance(v, np.ndarray)]

    assert not any(array.flags.writeable for array in cached)
    assert reference.features is reference.features
    assert len(pickle.dumps(reference)) == plain
    copied = pickle.loads(pickle.dumps(reference))
    np.testing.assert_array_equal(copied.features.stacked, reference.features.stacked)

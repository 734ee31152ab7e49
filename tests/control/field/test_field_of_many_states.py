"""The field at many states at once is the field at each."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_references import moving_reference, resting_reference, seeds

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus
from poil_drake.control.field.point_set_bcsdm import point_set_bcsdm as dut
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_exp

property_test = settings(derandomize=True, max_examples=40)

SAMPLES, COUNT, PERIOD = 40, 8, 0.1


def random_reference(rng: np.random.Generator) -> PointTrajectory:
    """Moves, pauses for five equal samples, and moves on."""
    progress = np.concatenate([np.linspace(0, 1, 20), np.ones(4), np.linspace(1, 2, 16)])
    body = rng.normal(scale=0.04, size=(COUNT, 3))
    turns = rotation_exp(progress[:, None] * rng.normal(size=3))
    path = progress[:, None] * rng.normal(scale=0.2, size=3) + [0.5, 0.2, 0.3]
    positions = body @ np.swapaxes(turns, -1, -2) + path[:, None]
    return moving_reference(positions, PERIOD)


def random_states(rng: np.random.Generator, reference: PointTrajectory, count: int) -> np.ndarray:
    """Random rigid states (count, N, 3) with noise of 0.5 mm."""
    starts = reference.positions[rng.integers(SAMPLES, size=count)]
    centres = starts.mean(axis=1, keepdims=True)
    turns = rotation_exp(rng.normal(scale=0.8, size=(count, 3)))
    moved = (starts - centres) @ turns.swapaxes(-1, -2) + centres
    moved += rng.normal(scale=0.1, size=(count, 1, 3))
    return moved + rng.normal(scale=5e-4, size=moved.shape)


def assert_each_is_the_single_field(
    points: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    confidence: np.ndarray | None = None,
    previous_tau: np.ndarray | None = None,
) -> list[BcsdmStatus]:
    """Compares all outputs and returns the statuses."""
    field = dut(points, reference, config, confidence, previous_tau)

    count = len(points)
    weights = [None] * count if confidence is None else confidence
    taus = [None] * count if previous_tau is None else previous_tau
    for b in range(count):
        expected = dut(points[b], reference, config, weights[b], taus[b])
        assert field.status[b] is expected.status
        for values, one in zip(field[:-1], expected[:-1], strict=True):
            np.testing.assert_allclose(values[b], one, rtol=0.0, atol=1e-9)
    return [BcsdmStatus(status) for status in field.status]


@given(seeds, st.sampled_from(["rigidity", "velocity", "none"]), st.booleans(), st.booleans())
@property_test
def test_random_states(seed, outlier_test, interpolate, weighted):
    rng = np.random.default_rng(seed)
    reference = random_reference(rng)
    points = random_states(rng, reference, 20)
    config = BcsdmConfig(outlier_test=outlier_test, interpolate=interpolate)
    confidence = rng.uniform(0.1, 1.0, size=(20, COUNT)) if weighted else None

    assert_each_is_the_single_field(points, reference, config, confidence)


@given(seeds, st.sampled_from(["rigidity", "velocity"]))
@property_test
def test_states_with_outliers(seed, outlier_test):
    rng = np.random.default_rng(seed)
    reference = random_reference(rng)
    points = random_states(rng, reference, 10)
    which = rng.random((10, COUNT)) < 0.2
    points[which] += rng.normal(scale=0.05, size=(np.count_nonzero(which), 3))

    assert_each_is_the_single_field(points, reference, BcsdmConfig(outlier_test=outlier_test))


@given(seeds)
@property_test
def test_states_with_points_that_were_not_observed(seed):
    rng = np.random.default_rng(seed)
    reference = random_reference(rng)
    points = random_states(rng, reference, 10)
    points[rng.random((10, COUNT)) < 0.15] = np.nan
    points[0, 2:] = np.nan
    confidence = rng.uniform(0.1, 1.0, size=(10, COUNT))
    confidence[rng.random((10, COUNT)) < 0.15] = 0.0
    confidence[1, 0] = np.nan

    statuses = assert_each_is_the_single_field(points, reference, BcsdmConfig(), confidence)

    assert statuses[0] is BcsdmStatus.LOST


@given(seeds, st.booleans())
@property_test
def test_equally_close_samples(seed, interpolate):
    rng = np.random.default_rng(seed)
    reference = random_reference(rng)
    # At the samples, those of the dwell among them, and in the middle between two.
    middles = 0.5 * (reference.positions[1:] + reference.positions[:-1])
    points = np.concatenate([reference.positions, middles])
    confidence = rng.uniform(0.1, 1.0, size=(len(points), COUNT))

    assert_each_is_the_single_field(
        points, reference, BcsdmConfig(interpolate=interpolate), confidence
    )


@given(seeds, st.sampled_from([0.0, 0.25, 0.9]))
@property_test
def test_states_within_a_progress_window(seed, escape_ratio):
    rng = np.random.default_rng(seed)
    reference = random_reference(rng)
    points = random_states(rng, reference, 20)
    previous = rng.uniform(-0.3, 4.3, size=20)
    previous[:5] = reference.times[rng.integers(SAMPLES, size=5)]
    previous[5] = np.nan
    backward, forward = rng.uniform(0.0, 0.6, size=2)
    config = BcsdmConfig(
        progress_window=(float(backward), float(forward)), window_escape_ratio=escape_ratio
    )

    assert_each_is_the_single_field(points, reference, config, previous_tau=previous)
    assert_each_is_the_single_field(points, reference, config)


@given(seeds)
@property_test
def test_states_at_the_goal(seed):
    rng = np.random.default_rng(seed)
    reference = random_reference(rng)
    offsets = rng.normal(scale=0.002, size=(20, 1, 3))
    points = reference.positions[-1] + offsets

    statuses = assert_each_is_the_single_field(points, reference, BcsdmConfig())

    near = np.linalg.norm(offsets[:, 0], axis=1) < 0.003
    assert [status is BcsdmStatus.GOAL for status in statuses] == near.tolist()


@pytest.mark.parametrize("min_rotation_spread", [0.0, 0.005])
def test_points_close_to_a_line(min_rotation_spread):
    body = np.random.default_rng(3).normal(size=(6, 3))
    positions = body * [0.1, 0.0, 0.0] + np.array([0.5, 0.0, 0.2])
    reference = resting_reference(positions)
    thickness = np.array([0.0, 1e-4, 9e-4, 0.003, 0.01])[:, None, None]
    points = positions + thickness * body + np.array([0.0, 0.02, 0.0])

    config = BcsdmConfig(min_rotation_spread=min_rotation_spread)
    statuses = assert_each_is_the_single_field(points, reference, config)

    assert statuses[0] is BcsdmStatus.LOST
    assert statuses[-1] is BcsdmStatus.OK


def test_three_points_have_no_outliers_and_two_are_lost():
    body = 0.1 * np.eye(3)
    points = body[None] + np.diag([0.0, 0.05, 0.0])

    statuses = assert_each_is_the_single_field(points, resting_reference(body), BcsdmConfig())
    lost = assert_each_is_the_single_field(
        points[:, :2], resting_reference(body[:2]), BcsdmConfig()
    )

    assert statuses == [BcsdmStatus.OK]
    assert lost == [BcsdmStatus.LOST]


@pytest.mark.parametrize("leading", [(), (0,), (3,), (2, 3)])
def test_outputs_have_the_leading_axes_of_the_points(leading):
    rng = np.random.default_rng(2)
    reference = random_reference(rng)
    points = rng.normal(size=(*leading, COUNT, 3))

    field = dut(points, reference, BcsdmConfig())

    sizes = {
        "omega": (3,),
        "v": (3,),
        "centroid": (3,),
        "inliers": (COUNT,),
        "target_points": (COUNT, 3),
    }
    for name, values in field._asdict().items():
        assert np.shape(values) == leading + sizes.get(name, ())
    assert field.twist.shape == (*leading, 6)


@pytest.mark.parametrize(
    ("points", "confidence"),
    [((4, 5, 3), (4, 8)), ((4, 8, 3), (8,)), ((8, 2), (8,)), ((8, 3), (7,))],
)
def test_shapes_must_agree(points, confidence):
    reference = random_reference(np.random.default_rng(0))

    with pytest.raises(InvalidValueError, match="shape"):
        dut(np.zeros(points), reference, BcsdmConfig(), np.ones(confidence))

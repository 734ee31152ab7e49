import numpy as np
import pytest
from hypothesis import given, settings
from point_references import resting_reference, seeds
from scipy.spatial.transform import Rotation

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.rollout import rollout
from poil_drake.control.theory import stability as dut
from poil_drake.geometry.rigid_transform import rotation_exp

property_test = settings(derandomize=True, max_examples=40)


def random_moments(rng):
    """Moments of any shape short of a line: eigenvalues over four decades."""
    axes = Rotation.random(random_state=rng.integers(2**31)).as_matrix()
    return (axes * 10.0 ** rng.uniform(-4.0, 0.0, size=3)) @ axes.T


def random_rotations(rng, count):
    return Rotation.random(count, random_state=rng.integers(2**31)).as_matrix()


def held_potential_change(W, R, h):
    """How D changes when the twist of R is held for h."""
    turned = R @ rotation_exp(h[..., None] * dut.rotation_velocity(W, R))
    return dut.rotation_potential(W, turned) - dut.rotation_potential(W, R)


@given(seeds)
@property_test
def test_limit_separates_steps_that_lower_the_potential_from_those_that_raise_it(seed):
    rng = np.random.default_rng(seed)
    W = random_moments(rng)
    R = random_rotations(rng, 50)

    limits = dut.sampling_gain_limit(W, R)

    for share in (0.05, 0.5, 0.99):
        assert np.all(held_potential_change(W, R, share * limits) < 0.0)
    assert np.all(held_potential_change(W, R, 1.01 * limits) > 0.0)


def test_a_step_without_motion_has_no_limit():
    assert dut.sampling_gain_limit(np.diag([1.0, 2.0, 3.0]), np.eye(3)) == np.inf


@given(seeds)
@property_test
def test_no_rotation_is_faster_than_the_largest_speed(seed):
    rng = np.random.default_rng(seed)
    W = random_moments(rng)

    speeds = np.linalg.norm(dut.rotation_velocity(W, random_rotations(rng, 2000)), axis=1)

    assert np.max(speeds) <= dut.largest_speed(W) <= np.sqrt(2.0)


@pytest.mark.parametrize("eigenvalues", [(1, 2, 3), (1, 1, 1.2), (0, 1, 1), (0.01, 0.02, 1)])
def test_largest_speed_is_reached(eigenvalues):
    W = np.diag(eigenvalues).astype(float)
    R = random_rotations(np.random.default_rng(0), 100_000)

    fastest = np.linalg.norm(dut.rotation_velocity(W, R), axis=1).max()

    # The best of so many rotations is some degrees off.
    assert 0.985 * dut.largest_speed(W) < fastest <= dut.largest_speed(W) + 1e-12


@given(seeds)
@property_test
def test_curvature_along_the_twist_is_at_most_that_at_the_goal(seed):
    rng = np.random.default_rng(seed)
    W = random_moments(rng)
    R = random_rotations(rng, 500)
    omega = dut.rotation_velocity(W, R)
    u = omega / np.linalg.norm(omega, axis=1, keepdims=True)
    step = 1e-3
    start, *around = (
        dut.rotation_potential(W, R @ rotation_exp(s * step * u)) for s in (0.0, 1.0, -1.0)
    )

    curvature = (around[0] + around[1] - 2.0 * start) / step**2

    at_goal = np.trace(W) - np.einsum("ni,ij,nj->n", u, W, u)
    assert np.all(curvature <= at_goal + 1e-6 * np.trace(W))


@given(seeds)
@property_test
def test_proven_gain_lowers_the_potential_from_everywhere(seed):
    rng = np.random.default_rng(seed)
    W = random_moments(rng)
    gain = dut.proven_sampling_gain(W)
    R = random_rotations(rng, 2000)

    assert 1.35 < gain <= np.pi / 2.0
    assert gain < dut.largest_sampling_gain(W, starts=500)
    assert np.all(held_potential_change(W, R, np.full(2000, gain)) < 0.0)


def test_gain_of_points_that_are_not_elongated_is_that_of_translation():
    for eigenvalues in ((1, 1, 1), (1, 2, 3), (0, 1, 1), (0, 1, 3), (1, 1, 7)):
        # The condition of A is at most 4.
        found = dut.largest_sampling_gain(np.diag(eigenvalues).astype(float))
        assert found == pytest.approx(2.0, abs=1e-6)


def test_gain_of_points_near_a_line_goes_to_a_quarter_turn():
    gains = [
        dut.largest_sampling_gain(np.diag([0.0, middle, 1.0])) for middle in (1e-1, 1e-2, 1e-3)
    ]

    assert gains == sorted(gains, reverse=True)
    assert all(gain > dut.WORST_SAMPLING_GAIN for gain in gains)
    assert gains[-1] < 1.62


# The field itself, held over a period.


def held_run(body, R, offset, h, steps):
    """Returns the field's potentials (steps,) if its twist is held for periods of h / eta."""
    eta = 3.0
    # With a goal tolerance of 0 the run continues at the goal.
    config = BcsdmConfig(eta=eta, goal_tolerance=0.0)
    points = body @ R.T + offset
    return rollout(
        points, resting_reference(body), config, h / eta, (steps - 0.5) * h / eta
    ).potentials


def body_with_moments(eigenvalues):
    """Two points on each axis, with W = diag(eigenvalues), in mm^2 times a thousand."""
    arms = np.sqrt(0.5 * np.array(eigenvalues, dtype=float)) * 0.03
    return np.concatenate([np.diag(arms), -np.diag(arms)])


@pytest.mark.parametrize("eigenvalues", [(1, 2, 3), (0.02, 0.02, 1), (0.001, 0.03, 1)])
def test_field_lowers_the_potential_at_every_period_just_below_the_limit(eigenvalues):
    body = body_with_moments(eigenvalues)
    gain = 0.995 * dut.largest_sampling_gain(np.diag(eigenvalues).astype(float))
    rng = np.random.default_rng(3)

    for R in random_rotations(rng, 25):
        potentials = held_run(body, R, rng.normal(scale=0.05, size=3), gain, 40)
        assert np.all(np.diff(potentials) < 0.0)


def test_field_diverges_just_above_the_limit_of_a_compact_set():
    body = body_with_moments((1, 2, 3))
    near = rotation_exp(np.array([1e-3, 0.0, 0.0]))

    assert np.all(np.diff(held_run(body, near, np.zeros(3), 1.99, 10)) < 0.0)
    assert np.all(np.diff(held_run(body, near, np.zeros(3), 2.01, 10)) > 0.0)


def test_field_raises_the_potential_just_above_the_limit_of_an_elongated_set():
    eigenvalues = (0.001, 0.03, 1)
    W = np.diag(eigenvalues)
    gain = dut.largest_sampling_gain(W)
    R = random_rotations(np.random.default_rng(0), 200_000)
    worst = R[np.argmin(dut.sampling_gain_limit(W, R))]

    below, above = (
        held_run(body_with_moments(eigenvalues), worst, np.zeros(3), h, 2)
        for h in (0.99 * gain, 1.03 * gain)
    )

    assert below[1] < below[0]
    assert above[1] > above[0]

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_references import seeds

from poil_drake.control.field.twist_fit import fit_twist
from poil_drake.control.theory import stability as dut
from poil_drake.geometry.rigid_transform import rotation_angle, rotation_exp, rotation_log

property_test = settings(derandomize=True, max_examples=100)


def centred_points(rng):
    # Different widths keep the eigenvalues of W apart.
    points = rng.normal(size=(10, 3)) * [1.0, 2.0, 3.0]
    return points - points.mean(axis=0)


def least_squares_velocity(points, R):
    """The fit of POIL eq. 3 with eta = 1 and the target at R = I, in the body frame."""
    fit = fit_twist(points @ R.T, points - points @ R.T, np.full(10, 0.1))
    return R.T @ fit.omega


def potential_hessian(W, R):
    """The Hessian of D in xi at a critical rotation R, with D(R exp([xi])) to second order."""
    return np.trace(W @ R) * np.eye(3) - W @ R


@given(seeds)
@property_test
def test_closed_form_is_the_least_squares_twist(seed):
    rng = np.random.default_rng(seed)
    points = centred_points(rng)
    R = rotation_exp(rng.normal(size=3) * 2.0)

    omega = dut.rotation_velocity(dut.moment_matrix(points), R)

    np.testing.assert_allclose(omega, least_squares_velocity(points, R), atol=1e-11)


@given(seeds)
@property_test
def test_potential_is_half_the_sum_of_squared_errors(seed):
    rng = np.random.default_rng(seed)
    points = centred_points(rng)
    R = rotation_exp(rng.normal(size=3))

    potential = dut.rotation_potential(dut.moment_matrix(points), R)

    assert potential == pytest.approx(0.5 * np.sum((points @ R.T - points) ** 2), rel=1e-12)


@given(seeds)
@property_test
def test_potential_falls_at_the_stated_rate(seed):
    rng = np.random.default_rng(seed)
    W = dut.moment_matrix(centred_points(rng))
    R = rotation_exp(rng.normal(size=3) * 2.0)
    omega = dut.rotation_velocity(W, R)
    step = 1e-5
    ahead = dut.rotation_potential(W, R @ rotation_exp(step * omega))
    behind = dut.rotation_potential(W, R @ rotation_exp(-step * omega))

    rate = -omega @ dut.point_inertia(W) @ omega

    assert rate <= 0.0
    assert (ahead - behind) / (2.0 * step) == pytest.approx(rate, rel=1e-5, abs=1e-6)


@given(seeds)
@property_test
def test_least_squares_twist_vanishes_at_the_critical_rotations(seed):
    points = centred_points(np.random.default_rng(seed))
    criticals = dut.critical_rotations(dut.moment_matrix(points))

    np.testing.assert_allclose(rotation_angle(criticals), np.pi, atol=1e-7)
    for R in (np.eye(3), *criticals):
        np.testing.assert_allclose(least_squares_velocity(points, R), np.zeros(3), atol=1e-12)


@given(seeds)
@property_test
def test_critical_rotations_are_not_minima(seed):
    W = dut.moment_matrix(centred_points(np.random.default_rng(seed)))

    negative = [
        np.count_nonzero(np.linalg.eigvalsh(potential_hessian(W, R)) < 0.0)
        for R in dut.critical_rotations(W)
    ]

    # In the principal frame of R*_k: -(l_i + l_j), l_k - l_i, l_k - l_j, with rising l.
    assert negative == [3, 2, 1]
    assert np.all(np.linalg.eigvalsh(potential_hessian(W, np.eye(3))) > 0.0)


@given(seeds)
@property_test
def test_hessian_is_the_second_difference_of_the_potential(seed):
    rng = np.random.default_rng(seed)
    W = dut.moment_matrix(centred_points(rng))
    xi = rng.normal(size=3)
    step = 1e-4

    for R in (np.eye(3), *dut.critical_rotations(W)):
        potentials = [
            dut.rotation_potential(W, R @ rotation_exp(s * step * xi)) for s in (-1, 0, 1)
        ]
        curvature = (potentials[0] - 2.0 * potentials[1] + potentials[2]) / step**2
        expected = xi @ potential_hessian(W, R) @ xi
        assert curvature == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.trace(W))


def critical_rotations_found(W, R):
    """Zeros of (R^T W - W R)^vee that Newton's method finds from rotations R (K, 3, 3).

    A small rotation xi in the body's frame changes this vector by -(tr(W R) I - (W R)^T) xi.
    """
    for _ in range(60):
        M = W @ R
        residual = np.stack(
            [M[:, 1, 2] - M[:, 2, 1], M[:, 2, 0] - M[:, 0, 2], M[:, 0, 1] - M[:, 1, 0]]
        )
        J = np.trace(M, axis1=1, axis2=2)[:, None, None] * np.eye(3) - np.swapaxes(M, 1, 2)
        step = np.einsum("kij,jk->ki", np.linalg.pinv(J), residual)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        R = R @ rotation_exp(step * np.minimum(1.0, 0.5 / np.maximum(length, 1e-12)))
    left = np.linalg.norm(np.swapaxes(R, 1, 2) @ W - W @ R, axis=(1, 2)) / np.trace(W)
    return R[left < 1e-10]


@given(seeds, st.booleans())
@settings(derandomize=True, max_examples=20)
def test_the_flow_rests_only_at_the_goal_and_three_rotations(seed, flat):
    rng = np.random.default_rng(seed)
    # Points in a plane have a singular W, but no other critical rotations.
    points = centred_points(rng) * ([0.0, 1.0, 1.0] if flat else [1.0, 1.0, 1.0])
    W = dut.moment_matrix(points @ rotation_exp(rng.normal(size=3)).T)
    known = np.stack([np.eye(3), *dut.critical_rotations(W)])

    found = critical_rotations_found(W, rotation_exp(rng.normal(size=(150, 3)) * 3.0))

    distances = rotation_angle(np.swapaxes(known, -1, -2)[:, None] @ found)
    assert len(found) > 75
    assert np.max(distances.min(axis=0)) < 1e-5
    assert set(np.argmin(distances, axis=0)) == {0, 1, 2, 3}


@given(seeds)
@settings(derandomize=True, max_examples=10)
def test_flow_of_any_points_converges_from_any_rotation(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(3, 12), 3)) * rng.uniform(0.3, 1.0, size=3)
    W = dut.moment_matrix(points)
    R = rotation_exp(rng.normal(size=(50, 3)) * 3.0)
    potential = dut.rotation_potential(W, R)

    for _ in range(400):
        R = R @ rotation_exp(0.1 * dut.rotation_velocity(W, R))
        fallen = dut.rotation_potential(W, R)
        assert np.all(fallen <= potential + 1e-12 * np.trace(W))
        potential = fallen

    assert np.max(rotation_angle(R)) < np.radians(0.1)


def test_symmetric_points_have_a_critical_circle_that_the_flow_leaves_at_full_rate():
    W = np.diag([1.0, 2.0, 2.0])
    angles = np.linspace(0.0, np.pi, 7)
    circle = rotation_exp(np.pi * np.stack([0.0 * angles, np.cos(angles), np.sin(angles)], axis=1))

    np.testing.assert_allclose(dut.rotation_velocity(W, circle), 0.0, atol=1e-12)
    for R in circle:
        # -(l_1 + l) about the own axis, 0 along the circle, l - l_1 about the first axis.
        np.testing.assert_allclose(
            np.sort(np.linalg.eigvalsh(potential_hessian(W, R))), [-3.0, 0.0, 1.0], atol=1e-9
        )


def test_moment_matrix_is_about_the_weighted_centroid():
    points = np.array([[0.0, 0, 0], [3.0, 0, 0]])

    # Centroid at x = 1: 2 * 1^2 + 1 * 2^2.
    assert dut.moment_matrix(points, np.array([2.0, 1.0]))[0, 0] == pytest.approx(6.0)


# The escape from the saddles.


def turned_moments(rng):
    """Moments of centred points whose principal axes are not those of the frame."""
    return dut.moment_matrix(centred_points(rng) @ rotation_exp(rng.normal(size=3)).T)


def times_to_turn(W, R, origin, angle, step=0.02, max_time=40.0):
    """Times at which the flow is `angle` away from `origin` [s], by the midpoint rule."""
    times = np.full(R.shape[:-2], np.nan)
    from_origin = np.swapaxes(origin, -1, -2)
    before = rotation_angle(from_origin @ R)
    for n in range(int(max_time / step)):
        half = R @ rotation_exp(0.5 * step * dut.rotation_velocity(W, R))
        R = R @ rotation_exp(step * dut.rotation_velocity(W, half))
        after = rotation_angle(from_origin @ R)
        crossed = np.isnan(times) & (after >= angle)
        times[crossed] = step * (n + (angle - before[crossed]) / (after - before)[crossed])
        before = after
        if not np.isnan(times).any():
            break
    return times


@given(seeds)
@settings(derandomize=True, max_examples=40)
def test_rates_are_those_of_the_flow_near_the_saddles(seed):
    W = turned_moments(np.random.default_rng(seed))
    axes = np.linalg.eigh(W)[1]
    step = 1e-5

    rates = dut.escape_rates(W)

    for k, saddle in enumerate(dut.critical_rotations(W)):
        for i in range(3):
            ahead, behind = (
                dut.rotation_velocity(W, saddle @ rotation_exp(s * step * axes[:, i]))
                for s in (1, -1)
            )
            np.testing.assert_allclose(
                (ahead - behind) / (2.0 * step), rates[k, i] * axes[:, i], atol=1e-8
            )


@pytest.mark.parametrize(("saddle", "axis"), [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 2)])
def test_escape_time_is_logarithmic_in_the_distance_in_every_unstable_direction(saddle, axis):
    # W is diagonal, so that rounding does not push the flow towards a faster direction.
    W = np.diag([1.0, 2.0, 4.0])
    rate = [[1.0, 3 / 5, 1 / 3], [2 / 6, 1.0, None], [None, None, 1.0]][saddle][axis]
    origin = dut.critical_rotations(W)[saddle]
    distances = np.geomspace(1e-3, 1e-1, 5)
    starts = origin @ rotation_exp(distances[:, None] * np.eye(3)[axis])

    measured = times_to_turn(W, starts, origin, angle=1.0)

    slope = np.polyfit(np.log(1.0 / distances), measured, 1)[0]
    assert slope == pytest.approx(1.0 / rate, rel=2e-3)
    np.testing.assert_allclose(measured, dut.escape_time(rate, distances, 1.0), atol=0.01)


@given(seeds)
@settings(derandomize=True, max_examples=10)
def test_escape_in_any_direction_has_the_fastest_rate(seed):
    rng = np.random.default_rng(seed)
    W = turned_moments(rng)
    axes = np.linalg.eigh(W)[1]
    distances = np.geomspace(1e-8, 1e-5, 4)
    directions = rng.normal(size=(3, 3))
    # Not across the saddle's own axis, whose part alone has the fastest rate.
    directions += 2.0 * (axes * np.sign(np.sum(directions * axes.T, axis=1))).T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    saddles = dut.critical_rotations(W)[:, None]
    starts = saddles @ rotation_exp(distances[:, None] * directions[:, None])

    measured = times_to_turn(W, starts, saddles, angle=1.0)

    slopes = np.polyfit(np.log(1.0 / distances), measured.T, 1)[0]
    # 1 / 1: the rate about the saddle's own axis. A competing rate r fades as distance^(1 - r).
    np.testing.assert_allclose(slopes, 1.0, rtol=0.05)


def test_flow_about_a_saddles_own_axis_ends_at_the_goal_and_about_another_at_a_saddle():
    W = np.diag([1.0, 2.0, 4.0])
    saddles = dut.critical_rotations(W)
    ends = {0: np.eye(3), 1: saddles[2], 2: saddles[1]}

    for axis, end in ends.items():
        R = saddles[0] @ rotation_exp(0.5 * np.eye(3)[axis])
        for _ in range(3000):
            R = R @ rotation_exp(0.02 * dut.rotation_velocity(W, R))
        assert np.linalg.norm(rotation_log(R.T @ end)) < 1e-6

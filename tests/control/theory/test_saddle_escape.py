import numpy as np
import pytest
from hypothesis import given, settings
from point_references import seeds

from poil_drake.control.theory import saddle_escape as dut
from poil_drake.control.theory.stability import (
    critical_rotations,
    moment_matrix,
    rotation_velocity,
)
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_angle, rotation_exp, rotation_log

property_test = settings(derandomize=True, max_examples=40)


def random_moments(rng):
    # Different widths keep the eigenvalues of W apart; the turn keeps its axes off the frame's.
    points = rng.normal(size=(10, 3)) * [1.0, 2.0, 3.0]
    return moment_matrix(points @ rotation_exp(rng.normal(size=3)).T)


def times_to_turn(W, R, origin, angle, step=0.02, max_time=40.0):
    """Times at which the flow is `angle` away from `origin` [s], by the midpoint rule."""
    times = np.full(R.shape[:-2], np.nan)
    from_origin = np.swapaxes(origin, -1, -2)
    before = rotation_angle(from_origin @ R)
    for n in range(int(max_time / step)):
        half = R @ rotation_exp(0.5 * step * rotation_velocity(W, R))
        R = R @ rotation_exp(step * rotation_velocity(W, half))
        after = rotation_angle(from_origin @ R)
        crossed = np.isnan(times) & (after >= angle)
        times[crossed] = step * (n + (angle - before[crossed]) / (after - before)[crossed])
        before = after
        if not np.isnan(times).any():
            break
    return times


@given(seeds)
@property_test
def test_rates_are_those_of_the_flow_near_the_saddles(seed):
    W = random_moments(np.random.default_rng(seed))
    axes = np.linalg.eigh(W)[1]
    step = 1e-5

    rates = dut.escape_rates(W)

    for k, saddle in enumerate(critical_rotations(W)):
        for i in range(3):
            ahead, behind = (
                rotation_velocity(W, saddle @ rotation_exp(s * step * axes[:, i])) for s in (1, -1)
            )
            np.testing.assert_allclose(
                (ahead - behind) / (2.0 * step), rates[k, i] * axes[:, i], atol=1e-8
            )


@pytest.mark.parametrize(("saddle", "axis"), [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 2)])
def test_escape_time_is_logarithmic_in_the_distance_in_every_unstable_direction(saddle, axis):
    # W is diagonal, so that rounding does not push the flow towards a faster direction.
    W = np.diag([1.0, 2.0, 4.0])
    rate = [[1.0, 3 / 5, 1 / 3], [2 / 6, 1.0, None], [None, None, 1.0]][saddle][axis]
    origin = critical_rotations(W)[saddle]
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
    W = random_moments(rng)
    axes = np.linalg.eigh(W)[1]
    distances = np.geomspace(1e-8, 1e-5, 4)
    directions = rng.normal(size=(3, 3))
    # Not across the saddle's own axis, whose part alone has the fastest rate.
    directions += 2.0 * (axes * np.sign(np.sum(directions * axes.T, axis=1))).T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    saddles = critical_rotations(W)[:, None]
    starts = saddles @ rotation_exp(distances[:, None] * directions[:, None])

    measured = times_to_turn(W, starts, saddles, angle=1.0)

    slopes = np.polyfit(np.log(1.0 / distances), measured.T, 1)[0]
    # 1 / 1: the rate about the saddle's own axis. A competing rate r fades as distance^(1 - r).
    np.testing.assert_allclose(slopes, 1.0, rtol=0.05)


def test_flow_about_a_saddles_own_axis_ends_at_the_goal_and_about_another_at_a_saddle():
    W = np.diag([1.0, 2.0, 4.0])
    saddles = critical_rotations(W)
    ends = {0: np.eye(3), 1: saddles[2], 2: saddles[1]}

    for axis, end in ends.items():
        R = saddles[0] @ rotation_exp(0.5 * np.eye(3)[axis])
        for _ in range(3000):
            R = R @ rotation_exp(0.02 * rotation_velocity(W, R))
        assert np.linalg.norm(rotation_log(R.T @ end)) < 1e-6


def test_stable_directions_and_collinear_points_are_rejected():
    with pytest.raises(InvalidValueError, match="rate"):
        dut.escape_time(-0.3, 0.1, 1.0)
    with pytest.raises(InvalidValueError, match="collinear"):
        dut.escape_rates(np.diag([0.0, 0.0, 1.0]))

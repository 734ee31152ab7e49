"""The purpose of each option of the field."""

import numpy as np
from hypothesis import given, settings
from point_references import moving_reference, resting_reference, seeds

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.field.rollout import rollout
from poil_drake.control.reference.make_reference import make_reference
from poil_drake.geometry.rigid_transform import rotation_exp

BODY = 0.03 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1.5, 0], [0, -1.5, 0], [0, 0, 2], [0, 0, -2]])
PERIOD = 1.0 / 32.0


def hairpin_reference(gap=0.02):
    """20 cm along x, over to the side by `gap`, and back."""
    out = np.linspace(0.0, 0.2, 65)
    over = np.linspace(0.0, gap, 9)[1:-1]
    path = np.concatenate(
        [
            np.stack([out, 0.0 * out, 0.0 * out], axis=1),
            np.stack([0.0 * over + 0.2, over, 0.0 * over], axis=1),
            np.stack([out[::-1], 0.0 * out + gap, 0.0 * out], axis=1),
        ]
    )
    return moving_reference(BODY + path[:, None], PERIOD)


# Hysteresis.


def branches_visited(config, ticks=400):
    """Whether the closest configuration of a noisy body between both legs is on the second."""
    reference = hairpin_reference()
    rng = np.random.default_rng(0)
    tau, legs = 0.1 / 0.2 * 64 * PERIOD, []
    for _ in range(ticks):
        points = BODY + np.array([0.1, 0.0099, 0.0]) + 1e-3 * rng.normal(size=BODY.shape)
        tau = point_set_bcsdm(points, reference, config, previous_tau=tau).tau
        legs.append(tau > 0.5 * reference.times[-1])
    return np.array(legs)


def test_window_keeps_noise_from_switching_between_branches():
    everywhere = branches_visited(BcsdmConfig(outlier_test="none"))
    held = branches_visited(BcsdmConfig(outlier_test="none", progress_window=(0.2, 0.2)))

    assert np.count_nonzero(np.diff(everywhere)) > 50
    assert np.count_nonzero(np.diff(held)) == 0
    assert not held.any()


def test_window_is_left_only_if_the_other_branch_is_much_closer():
    reference = hairpin_reference()
    config = BcsdmConfig(progress_window=(0.2, 0.2), window_escape_ratio=0.25)
    first, halfway = 0.5 * 64 * PERIOD, 0.5 * reference.times[-1]

    def leg(y, previous_tau):
        points = BODY + np.array([0.1, y, 0.0])
        return point_set_bcsdm(points, reference, config, previous_tau=previous_tau).tau > halfway

    # A quarter of the squared distance is half the distance: a third and two thirds of 20 mm.
    assert not leg(0.0130, first)
    assert leg(0.0136, first)
    last = reference.times[-1] - first
    assert leg(0.0070, last)
    assert not leg(0.0064, last)


# Interpolation.


@given(seeds)
@settings(derandomize=True, max_examples=15)
def test_field_is_lipschitz_along_lines_beside_the_reference(seed):
    rng = np.random.default_rng(seed)
    # Straight but at a varying speed: a straight line has no medial axis.
    progress = np.cumsum(rng.uniform(0.002, 0.006, size=40))
    reference = moving_reference(BODY + progress[:, None, None] * np.array([1.0, 0, 0]), PERIOD)
    start = BODY + rng.uniform([0.02, -0.02, -0.02], [0.1, 0.02, 0.02])
    direction = rng.normal(size=BODY.shape)
    direction /= np.linalg.norm(direction)

    def steepest(count, config):
        s = np.linspace(0.0, 0.01, count)
        twists = np.array(
            [point_set_bcsdm(start + t * direction, reference, config).twist for t in s]
        )
        return np.linalg.norm(np.diff(twists, axis=0), axis=1).max() / s[1]

    coarse, fine = (steepest(n, BcsdmConfig(outlier_test="none")) for n in (51, 501))

    # The slope of a field that jumps grows tenfold.
    assert fine < 1.2 * coarse


def test_field_turns_smoothly_with_a_turning_reference():
    # Between its samples a turning reference is a chord. On the inner side of the corners the
    # closest configuration jumps by their angle times the distance, so for points that move along
    # it the field jumps much less than from sample to sample.
    angles = np.linspace(0.0, 1.5, 60)
    turns = rotation_exp(angles[:, None] * np.array([0.0, 0.0, 1.0]))
    positions = BODY @ np.swapaxes(turns, 1, 2) + 0.2 * turns[:, None, :, 0]
    reference = moving_reference(positions, PERIOD)
    fine = rotation_exp(np.linspace(0.3, 0.5, 800)[:, None] * np.array([0.0, 0.0, 1.0]))

    def largest_jump(radius, interpolate):
        config = BcsdmConfig(interpolate=interpolate, outlier_test="none")
        states = BODY @ np.swapaxes(fine, 1, 2) + radius * fine[:, None, :, 0]
        twists = np.array([point_set_bcsdm(x, reference, config).twist for x in states])
        return np.linalg.norm(np.diff(twists, axis=0)[:, 3:], axis=1).max()

    for radius in (0.18, 0.22):
        assert largest_jump(radius, True) < 0.15 * largest_jump(radius, False)


# Time scaling.


@given(seeds)
@settings(derandomize=True, max_examples=20)
def test_potential_also_falls_under_speed_limits(seed):
    rng = np.random.default_rng(seed)
    reference = resting_reference(BODY)
    start = BODY @ rotation_exp(2.0 * rng.normal(size=3)).T + rng.normal(scale=0.2, size=3)

    run = rollout(
        start, reference, BcsdmConfig(), 1 / 32, 3.0, max_angular_speed=0.3, max_linear_speed=0.05
    )

    assert np.all(np.diff(run.potentials) < 0.0)


def test_speed_limits_keep_the_path():
    reference = resting_reference(BODY)
    start = BODY @ rotation_exp(np.array([0.5, 1.0, -0.7])).T + np.array([0.2, 0.1, 0.0])

    free = rollout(start, reference, BcsdmConfig(), 1 / 512, 10.0)
    limited = rollout(
        start, reference, BcsdmConfig(), 1 / 64, 30.0, max_angular_speed=0.3, max_linear_speed=0.05
    )

    assert limited.converged
    # Each pose of the slow run is one of the fast run's, up to the steps of both.
    distances = np.abs(limited.X_W[::20, None, :3] - free.X_W[:, :3]).max(axis=(2, 3)).min(axis=1)
    assert np.max(distances) < 3e-3
    assert limited.times[-1] > 2.0 * free.times[-1]


# Pauses and shapes that change.


def paused_demonstration(rate=16.0):
    """30 cm in 3 s, 2 s of rest, 20 cm to the side in 2 s, and 1 s of rest at either end."""
    times = np.arange(0.0, 9.0, 1.0 / rate)

    def ease(begin, end):
        u = np.clip((times - begin) / (end - begin), 0.0, 1.0)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)

    path = np.stack([0.3 * ease(1.0, 4.0), 0.2 * ease(6.0, 8.0), 0.0 * times], axis=1)
    return times, path


def test_a_pause_stops_the_field_unless_it_is_cut():
    times, path = paused_demonstration()
    # The tremor of a hand. The field stops where a sample's velocity points back.
    path = path + 1e-3 * np.random.default_rng(0).normal(size=path.shape)
    raw = moving_reference(BODY + path[:, None], times[1])
    prepared = make_reference(times, BODY + path[:, None])

    stalled = rollout(BODY, raw, BcsdmConfig(), PERIOD, 20.0)
    passed = rollout(BODY, prepared, BcsdmConfig(), PERIOD, 20.0)

    assert not stalled.converged
    assert stalled.taus[-1] < 6.0
    assert passed.converged


def test_a_changing_shape_keeps_the_field_from_its_goal_unless_a_rigid_one_is_fitted():
    times, path = paused_demonstration()
    rng = np.random.default_rng(0)
    # Points that drift over the body by a centimetre.
    creep = 0.012 * rng.normal(size=BODY.shape) * (times / times[-1])[:, None, None]
    shown = BODY + path[:, None] + creep
    raw = moving_reference(shown, times[1])
    prepared = make_reference(times, shown)
    end = BODY + path[-1]
    config = BcsdmConfig(outlier_test="none")

    def at_rest(reference, points):
        return rollout(points, reference, config, PERIOD, 5.0)

    assert not at_rest(raw, end).converged
    assert at_rest(prepared, prepared.positions[0] + path[-1]).converged

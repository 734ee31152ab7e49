import numpy as np
import pytest
from point_references import resting_reference
from scipy.spatial.transform import Rotation

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.theory import delay_stability as dut
from poil_drake.geometry.rigid_transform import rotation_exp

ETA = 3.0
# Two points on each axis, with the moments 1 : 2 : 3.
BODY = np.array([[s * r if i == j else 0.0 for j in range(3)]
                 for s in (1, -1) for i, r in enumerate((0.03, 0.0424, 0.052))])  # fmt: skip
REFERENCE = resting_reference(BODY)


def delayed_run(start, step, *, delay, hold, count):
    """Points and potentials under the field's twist of old points.

    Args:
        start: (6, 3) points, at rest there until now.
        step: Time step [s].
        delay: Age of the points when their twist begins, in steps.
        hold: How long each twist is held, in steps.
        count: Number of steps to simulate.
    """
    history = [start]
    output = point_set_bcsdm(start, REFERENCE, BcsdmConfig(eta=ETA))
    for n in range(count):
        if n >= delay and (n - delay) % hold == 0:
            output = point_set_bcsdm(history[n - delay], REFERENCE, BcsdmConfig(eta=ETA))
        points = history[-1]
        now = points.mean(axis=0)
        # The twist is that of a rigid motion, with v at the centroid's old position.
        v = output.v + np.cross(output.omega, now - output.centroid)
        turn = rotation_exp(step * output.omega)
        history.append((points - now) @ turn.T + now + step * v)
    points = np.array(history)
    return points, 0.5 * np.sum((points - BODY) ** 2, axis=(1, 2))


def random_start(rng, offset=0.05):
    turn = Rotation.random(random_state=rng.integers(2**31)).as_matrix()
    return BODY @ turn.T + rng.normal(scale=offset, size=3)


def near_start():
    return BODY @ rotation_exp(np.array([0.01, -0.02, 0.01])).T + np.array([1e-3, 2e-3, -1e-3])


def stable_limit(k):
    """Largest h for which e_{n+1} = e_n - h e_{n-k} is stable (Levin and May 1976)."""
    return 2.0 * np.sin(np.pi / (2.0 * (2.0 * k + 1.0)))


def overshoot_limit(k):
    """Largest h for which z^(k+1) - z^k + h has a positive root; the minimum is at k / (k + 1)."""
    return (k / (k + 1.0)) ** k / (k + 1.0)


@pytest.mark.parametrize("periods", [0, 1, 2, 3, 6])
def test_limits_of_whole_periods_are_the_closed_forms(periods):
    without_overshoot, stable = dut.delayed_loop_limits(periods)

    assert stable == pytest.approx(stable_limit(periods))
    # np.roots resolves a double root to about 1e-7.
    assert without_overshoot == pytest.approx(overshoot_limit(periods), rel=1e-5)


def test_limits_between_whole_periods():
    without_overshoot, stable = dut.delayed_loop_limits(0.5)

    # z^2 - (1 - h / 2) z + h / 2: stable to h = 2, and its discriminant vanishes at 6 - sqrt(32).
    assert stable == pytest.approx(2.0)
    assert without_overshoot == pytest.approx(6.0 - np.sqrt(32.0))


def test_many_short_periods_have_the_limits_of_the_continuous_delay():
    assert 500 * stable_limit(500) == pytest.approx(dut.LARGEST_DELAY_GAIN, rel=2e-3)
    assert 500 * overshoot_limit(500) == pytest.approx(
        dut.LARGEST_DELAY_GAIN_WITHOUT_OVERSHOOT, rel=2e-3
    )


@pytest.mark.parametrize("periods", [0, 1, 2, 3])
def test_field_settles_just_below_the_stable_gain_and_diverges_just_above(periods):
    limit = stable_limit(periods)
    _, below = delayed_run(near_start(), 0.96 * limit / ETA, delay=periods, hold=1, count=250)
    _, above = delayed_run(near_start(), 1.04 * limit / ETA, delay=periods, hold=1, count=150)

    assert np.max(below[-30:]) < 0.05 * np.max(below[:30])
    assert np.max(above[-30:]) > 3.0 * np.max(above[:30])


@pytest.mark.parametrize("periods", [1, 2, 3])
def test_field_with_delay_lowers_the_potential_up_to_the_gain_without_overshoot(periods):
    gain = overshoot_limit(periods)
    rng = np.random.default_rng(periods)

    # Also far off, where the twist of old points turns the object about a point that it has left.
    for offset in (0.05,) * 10 + (1.0,) * 10:
        start = random_start(rng, offset)
        _, potentials = delayed_run(start, gain / ETA, delay=periods, hold=1, count=60)
        # Down to rounding.
        assert np.all(np.diff(potentials)[potentials[:-1] > 1e-18] < 0.0)


@pytest.mark.parametrize("periods", [1, 2, 3])
def test_field_with_delay_passes_the_goal_above_that_gain(periods):
    gain = 1.15 * overshoot_limit(periods)
    points, potentials = delayed_run(
        BODY + np.array([0.1, 0.0, 0.0]), gain / ETA, delay=periods, hold=1, count=80
    )

    assert np.min(points.mean(axis=1)[:, 0]) < 0.0
    assert np.any(np.diff(potentials) > 0.0)


def test_field_with_a_continuous_delay_changes_where_the_limits_say():
    # The delay in 30 steps: its limits are within 2 % of those of a continuous one.
    def run(eta_delay, count):
        return delayed_run(near_start(), eta_delay / ETA / 30, delay=30, hold=1, count=count)[1]

    assert np.all(np.diff(run(0.97 * dut.LARGEST_DELAY_GAIN_WITHOUT_OVERSHOOT, 400)) < 0.0)
    settled, runaway = (run(s * dut.LARGEST_DELAY_GAIN, 1500) for s in (0.93, 1.05))
    assert np.max(settled[-200:]) < 0.2 * np.max(settled[:200])
    assert np.max(runaway[-200:]) > 2.0 * np.max(runaway[:200])


def test_tracker_of_the_paper_without_propagation_overshoots_and_settles():
    # 8 Hz and 0.1875 s: 1.5 periods, in steps of half a period; eta dt = 0.375.
    start = BODY + np.array([0.1, 0.0, 0.0])
    points, _ = delayed_run(start, 0.0625, delay=3, hold=2, count=120)
    expected = [1.0, 1.0, 1.0]
    for _ in range(60):
        expected.append(expected[-1] - 0.1875 * (expected[-2] + expected[-3]))

    offsets = points.mean(axis=1)[::2, 0] / 0.1

    np.testing.assert_allclose(offsets, expected[2:], atol=1e-9)
    size = np.max(np.abs(dut.delayed_loop_roots(0.375, 1.5)))
    without_overshoot, stable = dut.delayed_loop_limits(1.5)
    assert without_overshoot < 0.375 < stable
    assert size < 1.0
    assert -0.4 < np.min(offsets) < -0.1
    assert np.max(np.abs(offsets[40:])) < 2.0 * size**40

"""References of demonstrations that pause, and of those that turn back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.rollout import rollouts
from poil_drake.control.reference.make_reference import make_reference as dut
from poil_drake.control.reference.make_reference import sharp_turns
from poil_drake.errors import TransferError
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

BODY = np.random.default_rng(7).uniform(-1.0, 1.0, (10, 3)) * [0.03, 0.008, 0.04]
RATE = 8.0


def paused_demonstration(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) and positions (T, 10, 3) of a random motion with one to three pauses.

    Pauses are abrupt or ramped, may be next to the start or the end, and the hand may tremble.
    """
    duration, knots = rng.uniform(3.0, 7.0), np.linspace(0.0, 1.0, 4)
    where = np.sort(rng.uniform(0.05, 0.95, rng.integers(1, 4))) * duration
    clock, along = [0.0], [0.0]
    for begin, end in zip([0.0, *where], [*where, duration], strict=True):
        # A ramp takes up to 0.4 s longer than the motion would without the pause.
        ramp = rng.choice([0.0, rng.uniform(0.05, 0.4)])
        clock.append(clock[-1] + end - begin + ramp)
        along.append(end)
        clock.append(clock[-1] + rng.uniform(0.6, 3.0))
        along.append(end)
    times = np.arange(0.0, clock[-1] + 0.5, 1.0 / RATE)
    u = np.interp(times - 0.3, clock, along) / duration
    progress = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    via = np.cumsum(rng.normal(scale=0.06, size=(4, 3)) + np.array([0.12, 0.0, 0.0]), axis=0)
    path = CubicSpline(knots, via)(progress)
    turns = CubicSpline(knots, np.cumsum(rng.normal(scale=0.3, size=(4, 3)), axis=0))(progress)
    phases = 2.0 * np.pi * (rng.uniform(0.5, 3.0, 3) * times[:, None] + rng.random(3))
    path += rng.choice([0.0, 1e-3]) * np.sin(phases)
    positions = transform_points(make_transform(rotation_exp(turns), path), BODY)
    return times, positions + rng.choice([0.0, 1e-3]) * rng.normal(size=positions.shape)


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=25, deadline=None)
def test_every_start_reaches_the_goal_of_a_demonstration_with_pauses(seed):
    rng = np.random.default_rng(seed)
    times, positions = paused_demonstration(rng)

    reference = dut(times, positions)

    assert sharp_turns(reference.positions).size == 0
    base = reference.positions[rng.integers(len(reference.times), size=10)]
    centres = base.mean(axis=1, keepdims=True)
    scale = np.array([[0.1, 1.0]] * 5 + [[1.0, 0.1]] * 5)[:, :, None]
    turns = rotation_exp(scale[:, 0] * rng.normal(size=(10, 3)))
    turned = (base - centres) @ turns
    starts = turned + centres + 0.15 * scale[:, 1:] * rng.normal(size=(10, 1, 3))
    runs = rollouts(starts, reference, BcsdmConfig(), max_angular_speed=1.5, max_linear_speed=0.3)
    assert all(run.converged for run in runs)


def moved_along(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions of the body on a path (T, 3), after and before a second of rest."""
    rest = int(RATE)
    path = np.concatenate([np.repeat(path[:1], rest, 0), path, np.repeat(path[-1:], rest, 0)])
    return np.arange(len(path)) / RATE, BODY + path[:, None]


def test_a_hook_of_a_few_millimetres_is_rounded_off():
    # 20 cm along x, 3 mm back, then 20 cm along y, in steps of 2 cm and of 1 mm.
    there, back, on = np.arange(10) / 50, 0.2 - np.arange(3) / 1000, np.arange(10) / 50
    x = np.concatenate([there, back, np.full(len(on), 0.197)])
    y = np.concatenate([np.zeros(len(there) + len(back)), on])
    times, positions = moved_along(np.stack([x, y, 0.0 * x], axis=1))

    reference = dut(times, positions)

    assert sharp_turns(reference.positions).size == 0
    centres = reference.positions.mean(axis=1) - BODY.mean(axis=0)
    np.testing.assert_allclose(centres[-1], [0.197, 0.18, 0.0], atol=1e-4)
    assert np.linalg.norm(centres - [0.197, 0.0, 0.0], axis=1).min() < 0.01


def test_a_motion_that_returns_along_its_path_is_refused_with_time_and_place():
    s = np.concatenate([np.linspace(0.0, 0.2, 17), np.linspace(0.2, 0.05, 13)[1:]])
    times, positions = moved_along(s[:, None] * np.array([1.0, 0.0, 0.0]))

    # It turns back at 20 cm, after 1 s of rest and 2 s of motion; 1.5 cm of that are rounded off.
    said = r"turns back on itself (2\.[7-9]|3\.[0-3]) s .*\(0\.(18|19), "
    with pytest.raises(TransferError, match=said):
        dut(times, positions - BODY.mean(axis=0))

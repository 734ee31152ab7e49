"""The effect of delay and held twists on the field near its goal, simulated and in closed form."""

from typing import Any

import numpy as np

from poil_drake.benchmarks.stability.measures import COMPACT_MOMENTS
from poil_drake.control.theory.delay_stability import (
    LARGEST_DELAY_GAIN,
    LARGEST_DELAY_GAIN_WITHOUT_OVERSHOOT,
    delayed_loop_limits,
    delayed_loop_roots,
)
from poil_drake.control.theory.stability import rotation_potential, rotation_velocity
from poil_drake.geometry.rigid_transform import rotation_exp

_GRID, _PERIODS = 44, 500
"""Points along each axis of the map over delay and period; periods simulated at each point."""

_ETA, _TRACKER_PERIOD, _TRACKER_LATENCY = 3.0, 0.125, 0.1875
"""Gain [1/s], and period and latency of the paper's tracker [s]."""


def measure_delay() -> dict[str, Any]:
    """Returns the effect of delay and sampling period on the potential D, by name.

    "delays" and "periods" are the axes of a map, in units of 1 / eta. There, "verdicts" is 0 if D
    falls, 1 if it rises at times, and 2 if it does not settle. The other entries are limits in
    closed form, and a run with the paper's tracker.
    """
    W = np.diag(COMPACT_MOMENTS)
    # The centres of cells that fill the map.
    middles = (np.arange(_GRID) + 0.5) / _GRID
    delays, periods = np.meshgrid(1.8 * middles, 2.2 * middles)
    # Near the goal, so that the potential can grow.
    start = rotation_exp(np.array([0.02, -0.03, 0.025]))
    potentials = delayed_flow(W, start, delays.ravel(), periods.ravel(), count=_PERIODS)
    potentials = potentials.reshape(-1, *delays.shape)
    settles = potentials[-_PERIODS // 4 :].max(axis=0) < potentials[0]
    # Below 1e-12, D is rounding error: it is the difference of two traces.
    rises = np.any((np.diff(potentials, axis=0) > 0.0) & (potentials[:-1] > 1e-12), axis=0)
    ratios = np.concatenate([np.linspace(0.0, 4.0, 81), np.geomspace(4.2, 60.0, 25)])
    limits = np.array([delayed_loop_limits(ratio) for ratio in ratios])
    waited = _TRACKER_LATENCY / _TRACKER_PERIOD
    gain = _ETA * _TRACKER_PERIOD
    tracker_delays, tracker_periods = np.array([waited * gain]), np.array([gain])
    tracker_potentials = delayed_flow(W, start, tracker_delays, tracker_periods, count=100)[:, 0]
    return {
        "delays": delays[0],
        "periods": periods[:, 0],
        "verdicts": np.where(~settles, 2, np.where(rises, 1, 0)),
        "ratios": ratios,
        "limits_without_overshoot": limits[:, 0],
        "limits_stable": limits[:, 1],
        "continuous": [LARGEST_DELAY_GAIN_WITHOUT_OVERSHOOT, LARGEST_DELAY_GAIN],
        "tracker": {
            "eta_delay": waited * gain,
            "eta_period": gain,
            "limits": delayed_loop_limits(waited),
            "decay_per_period": np.max(np.abs(delayed_loop_roots(gain, waited))),
            "offsets": delayed_offsets(gain, waited, 60),
            "potentials": tracker_potentials / tracker_potentials[0],
        },
    }


def delayed_flow(
    W: np.ndarray, start: np.ndarray, delays: np.ndarray, periods: np.ndarray, *, count: int
) -> np.ndarray:
    """Returns the potentials (count + 1, K) of K rotations under delayed, held twists, at eta = 1.

    Each rotation is sampled at the start of each period. The twist of a sample, fixed in the world
    frame, begins to act after the delay, and acts until the next sample's twist replaces it. Before
    the first sample's twist acts, the rotations turn with the field's twist at `start`.

    Args:
        W: (3, 3) moment matrix of the points, as in `rotation_potential`.
        start: (3, 3) initial rotation.
        delays: (K,) delays of the twists [s].
        periods: (K,) times between two samples [s].
        count: Number of periods.
    """
    # Whole periods and the remainder, robust to rounding.
    whole = np.floor(delays / periods + 1e-9).astype(int)
    rest = np.clip(delays - whole * periods, 0.0, None)
    rows = np.arange(len(delays))
    R = np.broadcast_to(start, (len(delays), 3, 3))
    turns = np.zeros((count + 1, len(delays), 3))
    first = start @ rotation_velocity(W, start)
    potentials = [rotation_potential(W, R)]
    for n in range(count):
        turns[n] = np.einsum("kij,kj->ki", R, rotation_velocity(W, R))
        newer, older = n - whole, n - whole - 1
        omega = np.where((newer >= 0)[:, None], turns[np.maximum(newer, 0), rows], first)
        last = np.where((older >= 0)[:, None], turns[np.maximum(older, 0), rows], first)
        R = rotation_exp(rest[:, None] * last) @ R
        R = rotation_exp((periods - rest)[:, None] * omega) @ R
        potentials.append(rotation_potential(W, R))
    return np.array(potentials)


def delayed_offsets(gain: float, periods: float, count: int) -> np.ndarray:
    """Returns samples (count + 1,) of an offset that starts at 1, under delayed, held feedback.

    Args:
        gain: eta times the sampling period.
        periods: Delay divided by the sampling period.
        count: Number of periods.
    """
    whole = int(periods)
    rest = periods - whole
    offsets = [1.0] * (whole + 2)
    for _ in range(count):
        old = (1.0 - rest) * offsets[-1 - whole] + rest * offsets[-2 - whole]
        offsets.append(offsets[-1] - gain * old)
    return np.array(offsets[whole + 1 :])

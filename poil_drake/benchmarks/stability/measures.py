"""Simulations of the field near its goal, with what the theory predicts."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.control.theory.degenerate_points import point_set_condition
from poil_drake.control.theory.delay_stability import (
    LARGEST_DELAY_GAIN,
    LARGEST_DELAY_GAIN_WITHOUT_OVERSHOOT,
    delayed_loop_limits,
    delayed_loop_roots,
)
from poil_drake.control.theory.stability import (
    WORST_SAMPLING_GAIN,
    critical_rotations,
    escape_rates,
    escape_time,
    largest_sampling_gain,
    largest_speed,
    proven_sampling_gain,
    rotation_potential,
    rotation_velocity,
    sampling_gain_limit,
)
from poil_drake.geometry.rigid_transform import rotation_angle, rotation_exp

COMPACT_MOMENTS = (1.0, 2.0, 3.0)  # tr(W) I - W has the condition number 1.7.
ELONGATED_MOMENTS = (0.001, 0.03, 1.0)
"""Eigenvalues of a point set's moment matrix W; tr(W) I - W has the condition number 33."""

_CONDITIONS = 13
"""Number of point sets from compact to elongated."""

_POINT_NOISE = 0.001
"""Standard deviation of the noise in each coordinate of a point [m]."""

_MIN_ROTATION_SPREAD = 0.002
"""`BcsdmConfig.min_rotation_spread` of the field that limits the effect of noise [m]."""

_GRID, _PERIODS = 44, 500
"""Points along each axis of the map over delay and period; periods simulated at each point."""

_ETA, _TRACKER_PERIOD, _TRACKER_LATENCY = 3.0, 0.125, 0.1875
"""Gain [1/s], and period and latency of the paper's tracker [s]."""


def measure_escape() -> dict[str, Any]:
    """Returns how long the field takes to leave each saddle by 1 rad, along each unstable axis.

    The field's rotation is integrated by the midpoint rule at eta = 1.
    """
    W, end, step = np.diag(COMPACT_MOMENTS), 1.0, 0.02
    distances = np.geomspace(1e-3, 1e-1, 7)
    ways = []
    for k, (saddle, rates) in enumerate(zip(critical_rotations(W), escape_rates(W), strict=True)):
        for i in np.flatnonzero(rates > 0.0):
            R = saddle @ rotation_exp(distances[:, None] * np.eye(3)[i])
            times = np.full(len(R), np.nan)
            n, before = 0, distances
            while np.isnan(times).any():
                half = R @ rotation_exp(0.5 * step * rotation_velocity(W, R))
                R = R @ rotation_exp(step * rotation_velocity(W, half))
                angle = rotation_angle(saddle.T @ R)
                crossed = np.isnan(times) & (angle >= end)
                share = (end - before[crossed]) / (angle - before)[crossed]
                times[crossed] = step * (n + share)
                n, before = n + 1, angle
            slope = np.polyfit(np.log(1.0 / distances), times, 1)[0]
            ways.append(
                {
                    "saddle": k + 1,
                    "axis": int(i) + 1,
                    "rate": rates[i],
                    "times": times,
                    "predicted": escape_time(rates[i], distances, end),
                    "slope": slope,
                }
            )
    return {"moments": COMPACT_MOMENTS, "distances": distances, "end": end, "ways": ways}


def measure_sampling() -> dict[str, Any]:
    """Returns the effects of holding the twist for a sampling period dt, by name.

    "runs" has the potential D over time for some eta dt. "sets" has the largest eta dt that lowers
    D at random rotations. "curves" has limits of eta dt for point sets from compact to a line.
    """
    rng = np.random.default_rng(0)
    R = Rotation.random(4000, rng=rng).as_matrix()
    angles = rotation_angle(R)
    sets = {}
    for name, moments in (("compact", COMPACT_MOMENTS), ("elongated", ELONGATED_MOMENTS)):
        W = np.diag(moments)
        sets[name] = {
            "moments": moments,
            "angles": angles,
            "limits": sampling_gain_limit(W, R),
            "largest": largest_sampling_gain(W),
            "proven": proven_sampling_gain(W),
            "largest_speed": largest_speed(W),
        }
    W, runs = np.diag(COMPACT_MOMENTS), {}
    for gain in (0.5, 1.0, 1.5, 1.9, 2.0, 2.1):
        turned, potentials = rotation_exp(np.array([0.5, -0.4, 0.3])), []
        for _ in range(26):
            potentials.append(rotation_potential(W, turned))
            turned = turned @ rotation_exp(gain * rotation_velocity(W, turned))
        runs[str(gain)] = np.array(potentials) / potentials[0]
    conditions = np.geomspace(2.0, 1000.0, _CONDITIONS)
    # l_3 = 1; c is (l_2 + 1) / l_2 if flat (l_1 = 0), (l_2 + 1) / (2 l_2) if round (l_1 = l_2).
    flat = [np.diag([0.0, 1.0 / (c - 1.0), 1.0]) for c in conditions]
    round_ = [np.diag([*[1.0 / (2.0 * c - 1.0)] * 2, 1.0]) for c in conditions]
    return {
        "runs": runs,
        "sets": sets,
        "conditions": conditions,
        "curves": {
            "flat": [largest_sampling_gain(W) for W in flat],
            "round": [largest_sampling_gain(W) for W in round_],
            "flat_proven": [proven_sampling_gain(W) for W in flat],
        },
        "worst": WORST_SAMPLING_GAIN,
    }


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


def measure_noise() -> dict[str, Any]:
    """Returns the noise of omega due to noise in the points, for thin to thick point sets."""
    rng = np.random.default_rng(0)
    spreads = np.geomspace(0.0012, 0.03, _CONDITIONS)
    noise = _POINT_NOISE * rng.normal(size=(200, 8, 3))
    plain = BcsdmConfig(eta=1.0, outlier_test="none")
    limited = replace(plain, min_rotation_spread=_MIN_ROTATION_SPREAD)
    # Eight points along 10 cm, off their line on different sides.
    along = np.array([-1.0, -0.7, -0.4, -0.1, 0.1, 0.4, 0.7, 1.0]) * 0.05
    side = np.array([1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    rows: dict[str, list[float]] = {
        name: [] for name in ("condition", "predicted", "across", "measured", "limited")
    }
    for spread in spreads:
        body = np.stack([along, spread * side, 0.0 * side], axis=1)
        condition = point_set_condition(body)
        reference = PointTrajectory(
            np.array([0.0, 1.0]), np.stack([body, body]), np.zeros((2, *body.shape))
        )
        rows["condition"].append(condition.condition)
        rows["predicted"].append(_POINT_NOISE * condition.noise_per_error[2])
        rows["across"].append(_POINT_NOISE * condition.noise_per_error[0])
        for name, field in (("measured", plain), ("limited", limited)):
            turns = [point_set_bcsdm(body + e, reference, field).omega[0] for e in noise]
            rows[name].append(float(np.std(turns)))
    slowdown = np.minimum(1.0, (spreads / _MIN_ROTATION_SPREAD) ** 2)
    return {
        **rows,
        "spreads": spreads,
        "predicted_limited": slowdown * np.array(rows["predicted"]),
        "point_noise": _POINT_NOISE,
        "min_rotation_spread": _MIN_ROTATION_SPREAD,
    }

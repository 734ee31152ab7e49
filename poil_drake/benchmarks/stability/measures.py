"""Simulations of the field near its goal, with what the theory predicts."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.control.theory.degenerate_points import point_set_condition
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

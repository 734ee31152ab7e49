"""The plane on which marked things stand."""

import numpy as np

_REACH = 0.3  # [m] Radius around the marks in which the support is a plane.
_TOLERANCE = 0.008  # [m] Distance from a plane within which points vote for it.
_LEAST_TOLERANCE = 0.004  # [m] Lowest height at which something stands on the support.
_LEAST_SHARE = 0.3  # Least share of the points in reach that lie on the plane.
_SAMPLE, _HYPOTHESES = 2000, 200  # points and planes tried
_UPRIGHT = 0.9  # Least vertical component of the plane's normal.
_DEVIATIONS = 3.0  # standard deviations of the support's noise that belong to the support


def off_support(points: np.ndarray, *, around: np.ndarray, among: np.ndarray) -> np.ndarray | None:
    """Returns which points are above the plane on which things stand; None without a plane.

    It is the nearly horizontal plane through most points of the surroundings, by RANSAC.

    Args:
        points: (n, 3) [m, world].
        around: (3,) a point near the plane [m, world].
        among: (n,) bool, which points may show it.

    Returns:
        (n,) bool.
    """
    near = points[among & (np.linalg.norm(points - around, axis=1) < _REACH)]
    if len(near) < 3:
        return None
    draw = np.random.default_rng(0)
    sample = near[draw.integers(len(near), size=_SAMPLE)]
    a, b, c = sample[draw.integers(len(sample), size=(3, _HYPOTHESES))]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    normals *= np.sign(normals[:, 2:]) / np.where(lengths > 0.0, lengths, np.inf)[:, None]
    residuals = np.abs(sample @ normals.T - np.sum(normals * a, axis=1))
    shares = np.mean(residuals < _TOLERANCE, axis=0) * (normals[:, 2] > _UPRIGHT)
    best = int(np.argmax(shares))
    if shares[best] < _LEAST_SHARE:
        return None
    # Two planes that are near to each other may both vote for one between them: the second fit
    # drops the smaller one.
    votes = sample[residuals[:, best] < _TOLERANCE]
    for _ in range(2):
        origin, normal, deviation = _fit_plane(votes)
        votes = votes[np.abs((votes - origin) @ normal) < _DEVIATIONS * deviation]
    return (points - origin) @ normal > max(_DEVIATIONS * deviation, _LEAST_TOLERANCE)


def _fit_plane(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Returns a point of the plane through points (n, 3), its normal (3,), upwards, and the noise.

    The noise is the standard deviation of the distances from the plane [m], by their median.
    """
    origin = np.median(points, axis=0)
    normal = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2]
    normal *= np.sign(normal[2])
    origin = origin + np.median((points - origin) @ normal) * normal
    deviation = 1.48 * np.median(np.abs((points - origin) @ normal))
    return origin, normal, max(float(deviation), 1e-4)

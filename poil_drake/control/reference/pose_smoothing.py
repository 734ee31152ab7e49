"""Smooths noisy poses by local polynomial regression on translation and rotation."""

import numpy as np

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, rotation_log


def smooth_poses(
    times: np.ndarray, X: np.ndarray, query_times: np.ndarray, bandwidth: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns a smooth motion through noisy poses, and its spatial velocity, at query times.

    At each query time a quadratic is fitted to nearby samples with Gaussian weights and evaluated
    there, like a Savitzky-Golay filter for uneven samples. Rotations are fitted as rotation vectors
    relative to the estimate itself, in two rounds. The vectors are therefore small and do not wrap
    around, and the result is an exact rotation.

    Args:
        times: (T,) sample times [s], increasing.
        X: (T, 4, 4) noisy poses.
        query_times: (Q,) times at which to evaluate the motion [s].
        bandwidth: Standard deviation of the Gaussian [s]. Noise falls with the bandwidth's square
            root. Motion that takes less than about twice the bandwidth is smoothed away.

    Returns:
        X: (Q, 4, 4) smooth poses.
        V: (Q, 6) spatial velocities (omega [rad/s], v of the moving frame's origin [m/s]),
            expressed in the base frame.
    """
    times, query_times = np.asarray(times, dtype=float), np.asarray(query_times, dtype=float)
    nearby = _nearby_samples(times, query_times, bandwidth)
    weights = _value_and_slope_weights(times[nearby] - query_times[:, None], bandwidth)
    translation, v = np.einsum("qkj,qji->kqi", weights, X[nearby][..., :3, 3])
    nearest = np.argmin(np.abs(times[nearby] - query_times[:, None]), axis=1)
    R = X[nearby[np.arange(len(query_times)), nearest]][:, :3, :3]
    omega = np.zeros((len(query_times), 3))
    for _ in range(2):
        # Rotation vectors in the base's axes: once the value is zero, the slope is the angular
        # velocity.
        relative = X[nearby][..., :3, :3] @ np.swapaxes(R, -1, -2)[:, None]
        value, omega = np.einsum("qkj,qji->kqi", weights, rotation_log(relative))
        R = rotation_exp(value) @ R
    return make_transform(R, translation), np.concatenate([omega, v], axis=1)


def interpolate_poses(times: np.ndarray, X: np.ndarray, query_times: np.ndarray) -> np.ndarray:
    """Returns poses (Q, 4, 4) interpolated linearly in translation and rotation.

    Args:
        times: (T,) sample times, increasing.
        X: (T, 4, 4) poses at these times.
        query_times: (Q,) times of the result; clamped to the first and the last sample time.
    """
    position = np.interp(query_times, times, np.arange(len(times), dtype=float))
    index = np.minimum(position.astype(np.intp), max(len(times) - 2, 0))
    fraction = (position - index)[:, None]
    first, second = X[index], X[np.minimum(index + 1, len(times) - 1)]
    step = rotation_log(second[:, :3, :3] @ np.swapaxes(first[:, :3, :3], -1, -2))
    return make_transform(
        rotation_exp(fraction * step) @ first[:, :3, :3],
        first[:, :3, 3] + fraction * (second[:, :3, 3] - first[:, :3, 3]),
    )


def _nearby_samples(times: np.ndarray, query_times: np.ndarray, bandwidth: float) -> np.ndarray:
    """Returns the indices (Q, M) of the samples around each query time.

    M is the largest number of samples within four bandwidths of a query time, but at least 7 if
    there are so many samples.
    """
    reach = 4.0 * bandwidth
    begin = np.searchsorted(times, query_times - reach)
    end = np.searchsorted(times, query_times + reach, side="right")
    count = min(len(times), max(7, int(np.max(end - begin))))
    middle = np.searchsorted(times, query_times)
    begin = np.clip(middle - count // 2, 0, len(times) - count)
    return begin[:, None] + np.arange(count)


def _value_and_slope_weights(offsets: np.ndarray, bandwidth: float) -> np.ndarray:
    """Returns the weights (Q, 2, M) of samples at `offsets` (Q, M) [s] in the fit and its slope."""
    # Relative to the nearest sample, so that not all weights underflow in a gap.
    squares = (offsets / bandwidth) ** 2
    gaussian = np.exp(-0.5 * (squares - squares.min(axis=1, keepdims=True)))
    scaled = offsets / bandwidth
    powers = np.stack([np.ones_like(scaled), scaled, scaled**2], axis=1)
    weighted = powers * gaussian[:, None]
    gram = weighted @ np.swapaxes(powers, -1, -2)
    # A small ridge on slope and curvature regularises fits to too few samples.
    ridge = np.diag([0.0, 1e-9, 1e-9])
    coefficients = np.linalg.solve(gram + ridge, weighted)
    return coefficients[:, :2] / np.array([1.0, bandwidth])[:, None]

"""A reference that keeps the points as they were recorded, deformation included."""

import numpy as np

from poil_drake.control.reference.dwell import split_motion
from poil_drake.control.reference.make_reference import ReferenceConfig
from poil_drake.control.reference.point_trajectory import PointTrajectory, rms_length
from poil_drake.geometry.frozen_array import frozen_array


def reference_from_samples(
    times: np.ndarray, positions: np.ndarray, config: ReferenceConfig | None = None
) -> PointTrajectory:
    """Returns the reference through points that were recorded without noise.

    The pauses before and after the motion are cut off. Velocities are central differences, and zero
    at the end. Nothing is smoothed and no rigid shape is fitted, so the reference deforms as the
    object did. For tracked points of a rigid object use `make_reference`.

    Args:
        times: (T,) sample times [s], increasing.
        positions: (T, N, 3) positions [m, world], all finite.
        config: What counts as a pause, and the sample period.

    Raises:
        InvalidValueError: if a position is not finite.
        TransferError: if nothing moves.
    """
    config = config or ReferenceConfig()
    times = frozen_array(times, name="times", shape=("T",))
    positions = frozen_array(positions, name="positions", shape=(times.size, "N", 3))
    stretches = split_motion(
        times,
        rms_length(np.gradient(positions, times, axis=0)),
        positions,
        dwell_speed=config.dwell_speed,
        min_pause=config.min_pause,
        min_displacement=config.min_displacement,
    )
    kept = slice(max(stretches[0].start - 1, 0), stretches[-1].stop + 1)
    old_times = times[kept] - times[kept.start]
    # The object ends where it came to rest.
    shapes = np.concatenate([positions[kept][:-1], positions[-1:]])
    count = max(round(old_times[-1] / config.sample_period), 1)
    new_times = np.linspace(0.0, old_times[-1], count + 1)
    recorded = PointTrajectory(old_times, shapes, np.zeros_like(shapes))
    resampled = np.array([recorded.positions_at(time) for time in new_times])
    velocities = np.gradient(resampled, new_times, axis=0)
    velocities[-1] = 0.0
    return PointTrajectory(new_times, resampled, velocities)

"""A reference that keeps the points as they were recorded, deformation included."""

import numpy as np

from poil_drake.control.reference.dwell import split_motion
from poil_drake.control.reference.make_reference import ReferenceConfig
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import TransferError
from poil_drake.geometry.frozen_array import frozen_array


def reference_from_samples(
    times: np.ndarray, positions: np.ndarray, config: ReferenceConfig | None = None
) -> PointTrajectory:
    """Returns the reference through points that were recorded without noise.

    Where a demonstration stands still before and after its motion, it is cut; velocities are
    central differences, and zero at the end. Nothing is smoothed and no rigid shape is fitted, so
    that an object which deforms is followed as it deformed. `make_reference` is the choice for
    tracked points of a rigid object: it fits one shape to all samples and drops what does not fit.

    Args:
        times: (T,) sample times [s], increasing.
        positions: (T, N, 3) positions [m, world], all finite.
        config: What counts as standing still, and the sample period.

    Raises:
        InvalidValueError: if a position is not finite.
        TransferError: if nothing moves.
    """
    config = config or ReferenceConfig()
    times = frozen_array(times, name="times", shape=("T",))
    positions = frozen_array(positions, name="positions", shape=(times.size, "N", 3))
    speeds = np.sqrt(np.mean(np.sum(np.gradient(positions, times, axis=0) ** 2, axis=2), axis=1))
    stretches = split_motion(
        times,
        speeds,
        positions,
        dwell_speed=config.dwell_speed,
        min_pause=config.min_pause,
        min_displacement=config.min_displacement,
    )
    if not stretches:
        raise TransferError(
            f"Nothing moves in the demonstration of {times[-1] - times[0]:.1f} s.",
            remedy="Check the recording, or lower ReferenceConfig.dwell_speed and "
            "min_displacement.",
        )
    begin = max(stretches[0].begin - 1, 0)
    end = min(stretches[-1].end + 1, times.size)
    kept = positions[begin:end]
    # The last sample is where it came to rest.
    kept = np.concatenate([kept[:-1], positions[-1:]])
    own = times[begin:end] - times[begin]
    even = np.linspace(0.0, own[-1], max(round(own[-1] / config.sample_period), 1) + 1)
    segment = np.minimum(np.searchsorted(own, even, side="right") - 1, own.size - 2)
    share = ((even - own[segment]) / (own[segment + 1] - own[segment]))[:, None, None]
    resampled = (1.0 - share) * kept[segment] + share * kept[segment + 1]
    velocities = np.gradient(resampled, even, axis=0)
    velocities[-1] = 0.0
    return PointTrajectory(even, resampled, velocities)

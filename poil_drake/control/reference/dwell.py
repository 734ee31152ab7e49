"""The parts of a demonstration in which the object moves, without the pauses around them."""

import numpy as np

from poil_drake.control.reference.point_trajectory import rms_length
from poil_drake.errors import TransferError


def split_motion(
    times: np.ndarray,
    speeds: np.ndarray,
    positions: np.ndarray,
    *,
    dwell_speed: float,
    min_pause: float,
    min_displacement: float,
) -> list[slice]:
    """Returns the stretches of samples in which the points move, in order.

    The other samples are pauses. A reference must not contain them: the field would stop there.

    Args:
        times: (T,) [s].
        speeds: (T,) root mean square speed of the points [m/s].
        positions: (T, N, 3) positions of the points [m].
        dwell_speed: Slower samples are at rest [m/s].
        min_pause: Shorter pauses belong to the motion before and after them [s].
        min_displacement: A stretch in which the points stay within this distance of where they
            were at its beginning is noise [m, root mean square over the points].

    Raises:
        TransferError: if nothing moves.
    """
    moving = np.concatenate([[0], (speeds > dwell_speed).astype(np.int8), [0]])
    bounds = np.flatnonzero(np.diff(moving)).tolist()
    stretches: list[slice] = []
    for begin, end in zip(bounds[::2], bounds[1::2], strict=True):
        if rms_length(positions[begin:end] - positions[begin]).max() < min_displacement:
            continue
        if stretches and times[begin] - times[stretches[-1].stop - 1] < min_pause:
            begin = stretches.pop().start
        stretches.append(slice(begin, end))
    if not stretches:
        raise TransferError(
            f"Nothing moves in the demonstration: for {times[-1] - times[0]:.1f} s the points are "
            f"slower than {dwell_speed} m/s, or move by less than {min_displacement} m.",
            remedy="Check that the tracker followed the moving object, or lower "
            "ReferenceConfig.dwell_speed and min_displacement.",
        )
    return stretches

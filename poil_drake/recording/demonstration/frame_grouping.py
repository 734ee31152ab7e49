"""Groups the images of several streams by instant."""

from collections.abc import Sequence

import numpy as np


def group_by_stamp(streams: Sequence[np.ndarray]) -> np.ndarray:
    """Returns which messages of several streams belong together.

    The slowest stream sets the pace: each of its messages is paired with the nearest message of
    every other stream. If the nearest message is farther away than half the other stream's period,
    the other stream has a gap, and the instant is skipped. So a dropped image costs one frame, and
    images of different instants are never paired. No message is used twice.

    Args:
        streams: S arrays of stamps [ns], each sorted and of length >= 2.

    Returns:
        (F, S) indices into the streams, one row per instant, in chronological order.
    """
    periods = [median_period(stamps) for stamps in streams]
    pace = int(np.argmax(periods))
    instants = np.unique(streams[pace], return_index=True)[1]
    reference = streams[pace][instants]
    columns = [nearest(stamps, reference) for stamps in streams]
    columns[pace] = instants
    near = [
        np.abs(stamps[column] - reference) <= period / 2
        for stamps, column, period in zip(streams, columns, periods, strict=True)
    ]
    rows = np.stack(columns, axis=1)[np.all(near, axis=0)]
    kept = [row for i, row in enumerate(rows) if i == 0 or np.all(row > rows[i - 1])]
    return np.array(kept, dtype=np.int64).reshape(-1, len(streams))


def median_period(stamps: np.ndarray) -> float:
    """Returns the median time between the (T,) sorted stamps, in their unit."""
    return float(np.median(np.diff(stamps)))


def nearest(stamps: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Returns, for each time in `at`, the index of the nearest of the (T,) sorted stamps.

    If two stamps are equally near, the later one is chosen, so that streams half a period apart are
    paired consistently.
    """
    after = np.clip(np.searchsorted(stamps, at), 1, len(stamps) - 1)
    return np.where(at - stamps[after - 1] < stamps[after] - at, after - 1, after)

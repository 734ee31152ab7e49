"""Where a demonstration stands still: before, after and in the middle of its motion."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError


@dataclass(frozen=True)
class Interval:
    """Samples begin to end of a sequence, the end not included."""

    begin: int
    end: int

    def __len__(self) -> int:
        return self.end - self.begin


def split_motion(
    times: np.ndarray,
    speeds: np.ndarray,
    positions: np.ndarray,
    *,
    dwell_speed: float,
    min_pause: float,
    min_displacement: float,
) -> list[Interval]:
    """Returns the stretches of a motion, in order; between and around them it stands still.

    A reference has to be without its pauses: the closest configuration moves on only where the
    reference does, so the field comes to rest at a pause, as at the goal.

    Args:
        times: (T,) [s].
        speeds: (T,) root mean square speed of the points [m/s].
        positions: (T, N, 3) of the points [m].
        dwell_speed: What is slower stands still [m/s].
        min_pause: A slow stretch in the middle that is shorter than this is part of the motion [s].
        min_displacement: A fast stretch whose points stay within this of where they began is noise
            [m, root mean square over the points].
    """
    if not len(times) == len(speeds) == len(positions):
        raise InvalidValueError(
            f"There are {len(times)} times, {len(speeds)} speeds and {len(positions)} positions.",
            remedy="Pass one of each for every sample.",
        )
    stretches = [
        stretch
        for stretch in _runs(speeds > dwell_speed)
        if _displacement(positions[stretch.begin : stretch.end]) >= min_displacement
    ]
    joined: list[Interval] = []
    for stretch in stretches:
        if joined and times[stretch.begin] - times[joined[-1].end - 1] < min_pause:
            joined[-1] = Interval(joined[-1].begin, stretch.end)
        else:
            joined.append(stretch)
    return joined


def _runs(flags: np.ndarray) -> list[Interval]:
    changes = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [Interval(int(a), int(b)) for a, b in zip(changes[::2], changes[1::2], strict=True)]


def _displacement(positions: np.ndarray) -> float:
    offsets = positions - positions[0]
    return float(np.sqrt(np.max(np.mean(np.sum(offsets**2, axis=-1), axis=-1))))

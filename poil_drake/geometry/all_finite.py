"""Fast check that a few numbers are finite."""

import math

import numpy as np


def all_finite(values: np.ndarray) -> bool:
    """Returns whether all numbers of a small array are finite.

    For about ten numbers this is several times as fast as `np.all(np.isfinite(values))`, and the
    control loop calls it many times per tick.
    """
    return all(map(math.isfinite, values.ravel().tolist()))

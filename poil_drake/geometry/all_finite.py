"""Fast check that a few numbers are finite."""

import math

import numpy as np


def all_finite(values: np.ndarray) -> bool:
    """Returns whether no number of a small array is NaN or infinite.

    For about ten numbers it is several times as fast as `np.all(np.isfinite(values))`; the control
    loop calls it many times per tick.
    """
    return all(map(math.isfinite, values.ravel().tolist()))

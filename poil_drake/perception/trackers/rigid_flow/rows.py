"""Arrays that describe the same items, one row for each."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy


@dataclass(frozen=True, eq=False)
class Rows(SharedOnCopy):
    """Base class of dataclasses whose fields are all arrays with the same number of rows."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def select(self, index: np.ndarray) -> Self:
        """Returns the rows at the given indices (M,)."""
        return type(self)(*(getattr(self, f.name)[index] for f in fields(self)))

    def joined(self, other: Self, limit: int) -> Self:
        """Returns these rows followed by those of `other`, cut off after `limit` rows."""
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return type(self)(*(np.concatenate(pair)[:limit] for pair in pairs))


def evenly_spaced(length: int, count: int) -> np.ndarray:
    """Returns `count` indices spread evenly over `length` items, or all if `count` is larger."""
    return np.linspace(0, length - 1, min(length, count)).astype(np.intp)

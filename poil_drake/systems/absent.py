"""The value of an abstract port that has no value yet."""

from typing import Final

from poil_drake.geometry.frozen_array import SharedOnCopy


class Absent(SharedOnCopy):
    """Replaces None, which newer versions of Drake reject as an abstract value."""

    def __repr__(self) -> str:
        return "ABSENT"


ABSENT: Final = Absent()
"""The only instance."""

"""`ABSENT`, which abstract ports hold while they have nothing to show."""

from typing import Final

from poil_drake.geometry.frozen_array import SharedOnCopy


class Absent(SharedOnCopy):
    """The type of `ABSENT`. Newer versions of Drake reject None as an abstract value."""

    def __repr__(self) -> str:
        return "ABSENT"


ABSENT: Final = Absent()
"""The only instance of `Absent`."""

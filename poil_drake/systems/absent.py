"""What an abstract port holds before there is anything to hold."""

from typing import Final

from poil_drake.geometry.frozen_array import SharedOnCopy


class Absent(SharedOnCopy):
    """Stands for nothing: abstract values of newer Drakes take any object but None."""

    def __repr__(self) -> str:
        return "ABSENT"


ABSENT: Final = Absent()
"""The only one that is needed."""

"""A file of labels that grows mark by mark."""

import fcntl
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from poil_drake.errors import InvalidValueError, LabelError
from poil_drake.perception.detectors.by_hand.hand_labels import HandLabels, Mark
from poil_drake.perception.images import MultiViewFrame


@dataclass(frozen=True)
class LabelFile:
    """A file of labels that grows mark by mark; several processes may change it at once.

    Attributes:
        path: The file. It appears with the first mark.
        frame: The views that the marks are made on.
    """

    path: Path
    frame: MultiViewFrame

    def read(self) -> Sequence[Mark]:
        """Returns the marks in the file.

        Raises:
            LabelError: if the file is damaged, or belongs to other images.
        """
        return self._labels().marks

    def add(self, mark: Mark) -> Sequence[Mark]:
        """Adds a mark, which is on the disk when this returns, and returns all marks.

        A mark that is there already is not added again.

        Raises:
            LabelError: if the file is damaged, or belongs to other images.
            InvalidValueError: if the mark does not fit the views or roles.
            OSError: if the file cannot be written.
        """
        return self._change(lambda marks: marks if mark in marks else (*marks, mark))

    def undo(self, count: int) -> Sequence[Mark]:
        """Removes the last of `count` marks and returns the rest.

        If there are not exactly `count` marks, because another page has changed them, nothing is
        removed. The errors are those of `add`.
        """
        return self._change(lambda marks: marks[:-1] if len(marks) == count else marks)

    def _change(self, change: Callable[[tuple[Mark, ...]], tuple[Mark, ...]]) -> Sequence[Mark]:
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            # The file itself cannot be locked, because each change replaces it.
            fcntl.flock(folder, fcntl.LOCK_EX)
            labels = self._labels()
            changed = labels.with_marks(change(labels.marks))
            changed.save(self.path)
        finally:
            os.close(folder)
        return changed.marks

    def _labels(self) -> HandLabels:
        if not self.path.exists():
            return HandLabels.of(self.frame)
        labels = HandLabels.load(self.path)
        names = {camera.name for camera in self.frame.cameras}
        others = sorted({*labels.other_views(self.frame), *(names - labels.views.keys())})
        if others:
            raise LabelError(
                f"'{self.path}' has labels of other images: those of {', '.join(others)} differ.",
                remedy="Restore the scene, move the file away, or name another one with -o.",
            )
        return labels


def parse_mark(data: Mapping[str, Any]) -> Mark:
    """Returns the mark with the fields in `data`.

    Raises:
        InvalidValueError: if a field is missing, unknown or has the wrong type.
    """
    try:
        return Mark(**data)
    except (TypeError, ValueError) as error:
        if isinstance(error, InvalidValueError):
            raise
        raise InvalidValueError(f"{data} is not a mark.", remedy="Reload the page.") from error

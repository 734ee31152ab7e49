"""Boxes and clicks that a person made on the views of one scene, and their JSON file."""

import base64
import binascii
import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Self

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError, LabelError
from poil_drake.perception.images import MultiViewFrame
from poil_drake.runtime.output_files import whole_file

ROLES = ("object", "part", "fixture")
"""What a mark can belong to."""

BOX, INCLUDE, EXCLUDE = "box", "include", "exclude"
"""The kinds of marks: a box around something, a click on it, and a click on what is not it."""

_NUMBERS = {BOX: 4, INCLUDE: 2, EXCLUDE: 2}
_FORMAT = "poil_drake hand labels 1"

# A cell of a 640 x 480 image averages 10 x 10 pixels. Rendered mugs that move by 5 mm or turn by
# 10 degrees change 13 to 25 cells by this much; noise of 8 grey levels with 4 % more light, and an
# arm that returns within 0.01 rad, change none.
_CELLS = (64, 48)  # columns and rows
_GREY_TOLERANCE = 16  # of 255
_MOST_CHANGED_CELLS = 10


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A box or a click.

    Attributes:
        view: Name of the camera.
        role: What it marks, e.g. one of `ROLES`.
        kind: `BOX`, `INCLUDE` or `EXCLUDE`.
        at: (left, top, right, bottom) of a box, (u, v) of a click [px].
    """

    view: str
    role: str
    kind: str
    at: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", tuple(self.at))
        if not (isinstance(self.view, str) and isinstance(self.role, str)):
            raise InvalidValueError(
                f"A mark has the view {self.view!r} and the role {self.role!r}.",
                remedy="Both are names.",
            )
        numbers = all(type(x) in (int, float) and math.isfinite(x) for x in self.at)
        if len(self.at) != _NUMBERS.get(self.kind) or not numbers:
            raise InvalidValueError(
                f"A mark of kind {self.kind!r} is at {list(self.at)}.",
                remedy=f"Use four numbers for '{BOX}', two for '{INCLUDE}' and '{EXCLUDE}'.",
            )
        if self.kind == BOX and not (self.at[0] < self.at[2] and self.at[1] < self.at[3]):
            raise InvalidValueError(
                f"A box at {list(self.at)} has no area.",
                remedy="Give left, top, right and bottom, in this order.",
            )


@dataclass(frozen=True, kw_only=True)
class LabelledView:
    """The image that marks were made on.

    Attributes:
        width: Its width [px].
        height: Its height [px].
        fingerprint: A small grey image of it, in base64.
    """

    width: int
    height: int
    fingerprint: str

    def __post_init__(self) -> None:
        if not all(type(size) is int and size > 0 for size in (self.width, self.height)):
            raise InvalidValueError(
                f"The image of a view has {self.width!r} x {self.height!r} pixels.",
                remedy="Use whole numbers of at least 1.",
            )
        if self._cells.size != math.prod(_CELLS):
            raise InvalidValueError(
                f"A view's fingerprint has {self._cells.size} cells, not {math.prod(_CELLS)}.",
                remedy="Make the labels again with `poil label`.",
            )

    @classmethod
    def of(cls, rgb: np.ndarray) -> Self:
        """Returns the view of an image (H, W, 3) uint8."""
        cells = base64.b64encode(_grey_cells(rgb).tobytes()).decode()
        return cls(width=rgb.shape[1], height=rgb.shape[0], fingerprint=cells)

    def shows(self, rgb: np.ndarray) -> bool:
        """Returns whether an image (H, W, 3) uint8 shows the same scene.

        Noise and a change of the light as a whole are tolerated.
        """
        if rgb.shape[:2] != (self.height, self.width):
            return False
        change = _grey_cells(rgb).ravel().astype(int) - self._cells
        changed = np.abs(change - np.median(change)) > _GREY_TOLERANCE
        return int(changed.sum()) <= _MOST_CHANGED_CELLS

    @cached_property
    def _cells(self) -> np.ndarray:
        try:
            return np.frombuffer(base64.b64decode(self.fingerprint, validate=True), np.uint8)
        except binascii.Error as error:
            raise InvalidValueError(
                "A view's fingerprint is not base64.",
                remedy="Make the labels again with `poil label`.",
            ) from error


def _grey_cells(rgb: np.ndarray) -> np.ndarray:
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    return cv2.resize(grey, _CELLS, interpolation=cv2.INTER_AREA)


@dataclass(frozen=True, kw_only=True)
class HandLabels:
    """The marks on the views of one scene.

    Attributes:
        views: The images, by the names of their cameras.
        marks: The boxes and clicks, in the order in which they were made. Of several boxes of one
            role in one view, the last counts.
    """

    views: Mapping[str, LabelledView]
    marks: tuple[Mark, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "views", MappingProxyType(dict(self.views)))
        if not self.views:
            raise InvalidValueError("Labels have no views.", remedy="Label at least one image.")
        for mark in self.marks:
            view = self.views.get(mark.view)
            if view is None or mark.role not in ROLES:
                raise InvalidValueError(
                    f"A mark has the view '{mark.view}' and the role '{mark.role}'.",
                    remedy=f"There are the views {', '.join(self.views)} and the roles "
                    f"{', '.join(ROLES)}.",
                )
            largest = (view.width, view.height) * 2
            if not all(0 <= x <= size for x, size in zip(mark.at, largest, strict=False)):
                raise InvalidValueError(
                    f"A mark in view '{mark.view}' at {list(mark.at)} is outside of the image, "
                    f"which has {view.width} x {view.height} pixels.",
                    remedy="Mark what the image shows.",
                )

    @classmethod
    def of(cls, frame: MultiViewFrame) -> Self:
        """Returns labels without marks for the views of a frame."""
        views = zip(frame.cameras, frame.images, strict=True)
        return cls(views={camera.name: LabelledView.of(image.rgb) for camera, image in views})

    def with_marks(self, marks: Iterable[Mark]) -> Self:
        """Returns labels of the same views with other marks."""
        return replace(self, marks=tuple(marks))

    def box(self, view: str, role: str) -> tuple[float, ...] | None:
        """Returns (left, top, right, bottom) of a role in a view [px]; None if it has no box."""
        boxes = [mark.at for mark in self._marks(view, role, BOX)]
        return boxes[-1] if boxes else None

    def clicks(self, view: str, role: str, *, include: bool) -> np.ndarray:
        """Returns the clicks (n, 2) on a role in a view, or on what is not it [px]."""
        marks = self._marks(view, role, INCLUDE if include else EXCLUDE)
        return np.array([mark.at for mark in marks], dtype=float).reshape(-1, 2)

    def other_views(self, frame: MultiViewFrame) -> list[str]:
        """Returns the names of the views that a frame lacks or shows differently."""
        images = zip(frame.cameras, frame.images, strict=True)
        rgb = {camera.name: image.rgb for camera, image in images}
        return [n for n, view in self.views.items() if n not in rgb or not view.shows(rgb[n])]

    def _marks(self, view: str, role: str, kind: str) -> list[Mark]:
        wanted = (view, role, kind)
        return [mark for mark in self.marks if (mark.view, mark.role, mark.kind) == wanted]

    def save(self, path: str | Path) -> None:
        """Writes a JSON file, whole and on the disk when this returns.

        Raises:
            OSError: if the file cannot be written.
        """
        views = {name: asdict(view) for name, view in self.views.items()}
        marks = [asdict(mark) for mark in self.marks]
        text = json.dumps({"format": _FORMAT, "views": views, "marks": marks}, indent=1)
        with whole_file(Path(path)) as file:
            file.write(text.encode())
            file.flush()
            os.fsync(file.fileno())

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Reads a file that `save` wrote.

        Raises:
            LabelError: if the file is missing, damaged or something else.
        """
        again = "Make the labels again with `poil label`."
        try:
            data = json.loads(Path(path).read_bytes())
            if data["format"] != _FORMAT:
                raise InvalidValueError(
                    f"Its format is {data['format']!r}, not '{_FORMAT}'.", remedy=again
                )
            views = {name: LabelledView(**view) for name, view in data["views"].items()}
            return cls(views=views, marks=tuple(Mark(**mark) for mark in data["marks"]))
        except OSError as error:
            raise LabelError(
                f"'{path}', the labels made by hand, cannot be read ({error.strerror}).",
                remedy="Make them with `poil label`.",
            ) from error
        except InvalidValueError as error:
            raise LabelError(f"'{path}': {error.problem}", remedy=error.remedy) from error
        except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
            raise LabelError(
                f"'{path}' is damaged, or not a file of labels made by hand ({error}).",
                remedy=again,
            ) from error
        except RecursionError as error:
            raise LabelError(f"'{path}' is nested too deeply.", remedy=again) from error


def labels_path(scene: str | Path) -> Path:
    """Returns where the labels of a demonstration (.mcap) or scenario (.yaml) are: beside it."""
    return Path(scene).with_suffix(".labels.json")

"""The parts of a task of the control study."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

import poil_drake.models

MODELS = Path(poil_drake.models.__file__).parent


@dataclass(frozen=True, kw_only=True)
class Fixture:
    """A static model.

    Attributes:
        file: SDFormat file, relative to the package's models.
        link: Name of its link that is welded to the world.
        position: Position of that link [m, world].
    """

    file: str
    link: str
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlTask:
    """A task: an object, the fixtures, and the one demonstration.

    Attributes:
        name: Name in files and on the command line.
        title: The paper's name, in tables and pictures.
        object_file: SDFormat file of the object, relative to the package's models.
        fixtures: The static models.
        carriers: N names of the object's links, one per point: the link that carries it.
        link_points: (N, 3) the points in these links' frames [m].
        times: (K,) times of the demonstration's keyframes [s].
        keyframes: (K, 4, 4) poses of the object's first link in them.
        criterion: The paper's criterion of success. "center": the object's frame is within 1 cm of
            the demonstration's end; "points": the mean distance of the points to it is below 1 cm.
        far_lower: Corner of the Far region in x and y, from the demonstration's start [m].
        far_upper: The opposite corner [m].
        rigid: Whether the object keeps its shape; only then its weight is compensated.
        paper: Success of the paper's rows in percent, (near, far) by row (its table II).
    """

    name: str
    title: str
    object_file: str
    fixtures: tuple[Fixture, ...]
    carriers: tuple[str, ...]
    link_points: np.ndarray
    times: np.ndarray
    keyframes: np.ndarray
    criterion: Literal["center", "points"]
    far_lower: tuple[float, float] = (-0.40, -0.40)
    far_upper: tuple[float, float] = (0.40, 0.40)
    rigid: bool = True
    paper: dict[str, tuple[int, int]]

    @property
    def start(self) -> np.ndarray:
        """(4, 4) pose at the start of the demonstration [m, world]."""
        return self.keyframes[0]


NEAR_HALF = (0.05, 0.05)
"""Half the size along x and y of the Near region, in which demonstrations are collected [m]."""

SUCCESS_DISTANCE = 0.01
"""The paper's limit for success [m]."""

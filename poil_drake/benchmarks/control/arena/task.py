"""What defines a task of the control study."""

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
        link: Name of the link that is welded to the world.
        position: Position of that link [m, world].
    """

    file: str
    link: str
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlTask:
    """A task of the paper (POIL): an object, the fixtures, and the one demonstration.

    Attributes:
        name: Name in files and on the command line.
        title: Name in tables and pictures, taken from the paper.
        object_file: SDFormat file of the object, relative to the package's models.
        fixtures: The static models.
        carriers: For each of the N points, the name of the object's link that carries it.
        link_points: (N, 3) the points, each in the frame of its link [m].
        times: (K,) times of the demonstration's keyframes [s].
        keyframes: (K, 4, 4) poses of the object's first link at these times.
        criterion: Whether the distance from the goal, the demonstration's end, is that of the
            object's origin ("center") or the mean distance of the points ("points").
        far_lower: Lower corner (x, y) of the Far region, from the demonstration's start [m].
        far_upper: Upper corner (x, y) of the Far region, from the demonstration's start [m].
        rigid: Whether the object keeps its shape. Gravity does not act on a rigid object.
        paper: Success rates (near, far) [%] by row of the paper's table II.
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
        """(4, 4) pose of the object's first link at the start of the demonstration, world."""
        return self.keyframes[0]


NEAR_HALF = (0.05, 0.05)
"""Half the extent in x and y of the Near region, centred at the demonstration's start [m]."""

SUCCESS_DISTANCE = 0.01
"""A trial succeeds below this distance from the goal, as in the paper (POIL) [m]."""

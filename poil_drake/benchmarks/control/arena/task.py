"""What a task of the control study consists of."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

import poil_drake.models

MODELS = Path(poil_drake.models.__file__).parent

Criterion = Literal["center", "points"]


@dataclass(frozen=True, kw_only=True)
class Fixture:
    """Something that stands still.

    Attributes:
        file: SDFormat file, relative to the package's models.
        link: Which of its links is welded to the world.
        position: Where [m, world].
    """

    file: str
    link: str
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlTask:
    """A task: an object, what stands around, and how the one demonstration goes.

    Attributes:
        name: In files and on the command line.
        title: In tables and pictures; the paper's.
        object_file: SDFormat file of the object, relative to the package's models.
        fixtures: What stands around.
        carriers: N names of the object's links, those that the points belong to.
        link_points: (N, 3) the points in these links' frames [m].
        times: (K,) when the demonstration passes its keyframes [s].
        keyframes: (K, 4, 4) poses of the object's first link there.
        criterion: "center": success is the object's frame within 1 cm of the demonstration's end;
            "points": the mean distance of the points to it is below 1 cm (the paper's).
        far_lower: Corner of the Far region in x and y, from the demonstration's start [m].
        far_upper: The opposite corner [m].
        rigid: Whether it keeps its shape; the weight of what does not is not compensated.
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
    criterion: Criterion
    far_lower: tuple[float, float] = (-0.40, -0.40)
    far_upper: tuple[float, float] = (0.40, 0.40)
    rigid: bool = True
    paper: dict[str, tuple[int, int]]

    @property
    def start(self) -> np.ndarray:
        """(4, 4) where the demonstration starts [m, world]."""
        return self.keyframes[0]


NEAR_HALF = (0.05, 0.05)
"""Half the size of the Near region along x and y [m]: where demonstrations are collected."""

SUCCESS_DISTANCE = 0.01
"""The paper's limit for success [m]."""

"""What every controller of the control study is: a function of state and observation."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Observation:
    """What a controller sees at one instant.

    Attributes:
        time: Since the start of the trial [s].
        points: (N, 3) the functional part's points [m, world]; NaN where not observed.
        confidence: (N,) in [0, 1].
        X_WO: (4, 4) pose of the object's driven body. Only policies that are granted a known pose
            may look at it.
        X_WH: (4, 4) pose of the hand, as any arm knows it from its joints; NaN where not known.
    """

    time: float
    points: np.ndarray
    confidence: np.ndarray
    X_WO: np.ndarray
    X_WH: np.ndarray = field(default_factory=lambda: np.full((4, 4), np.nan))


class CommandedTwist(NamedTuple):
    """A rigid motion.

    Attributes:
        V: (6,) (omega [rad/s], v [m/s] of `point`), world.
        point: (3,) the place that moves with v [m, world].
    """

    V: np.ndarray
    point: np.ndarray


class Policy(Protocol):
    """A controller. What it remembers between steps is its state, never an attribute.

    Attributes:
        period: Time between two steps [s].
    """

    period: float

    def start(self) -> Any:
        """Returns the state before the first step."""

    def step(self, state: Any, observation: Observation) -> tuple[Any, CommandedTwist]:
        """Returns the next state and the motion wanted until the next step.

        The state that is passed stays as it was.
        """

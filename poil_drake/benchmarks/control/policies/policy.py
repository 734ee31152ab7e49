"""The interface of the study's controllers: functions of state and observation."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Observation:
    """The input of a controller at one instant.

    Attributes:
        time: Time since the start of the trial [s].
        points: (N, 3) the functional part's points [m, world]; NaN where not observed.
        confidence: (N,) in [0, 1].
        X_WO: (4, 4) true pose of the object's driven body, for policies that assume a known pose.
        X_WH: (4, 4) pose of the hand, which an arm knows from its joints.
    """

    time: float
    points: np.ndarray
    confidence: np.ndarray
    X_WO: np.ndarray
    X_WH: np.ndarray


class CommandedTwist(NamedTuple):
    """The rigid motion that a policy commands.

    Attributes:
        V: (6,) (omega [rad/s], v [m/s] of `point`), world.
        point: (3,) the point that moves with v [m, world].
    """

    V: np.ndarray
    point: np.ndarray


class Policy(Protocol):
    """A controller. It keeps its memory between steps in its state, never in an attribute.

    Attributes:
        period: Time between two steps [s].
    """

    period: float = 1 / 64

    def start(self) -> Any:
        """Returns the state before the first step; None by default."""
        return None

    def step(self, state: Any, observation: Observation) -> tuple[Any, CommandedTwist]:
        """Returns the next state and the motion until the next step.

        The argument `state` is not modified. An attribute `note` of the last state becomes
        `ControlTrial.note`.
        """

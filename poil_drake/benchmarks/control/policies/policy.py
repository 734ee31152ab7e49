"""The study's controllers: functions of state and observation, and the system that runs them."""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.control.field.twist_fit import scale_twist, shift_twist


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

        The argument `state` is not modified.
        """

    def note(self, state: Any) -> str:
        """Returns a remark on a state, for `ControlTrial.note`; empty by default."""
        return ""


class PolicySystem(LeafSystem):
    """Runs a policy under the speed limits that hold for all policies.

    .. pydrake_system::

        name: PolicySystem
        input_ports:
        - points
        - confidence
        - object_pose
        - hand_pose
        output_ports:
        - twist
        - point

    Inputs: `points` (3N,) row-major [m, world], `confidence` (N,), `object_pose` (16,) X_WO and
    `hand_pose` (16,) X_WH, both row-major. The policy takes one step per period. Outputs are the
    command of the last step, and zero before the first step:

    - `twist` (6,): (omega [rad/s], v [m/s]) of `point`, world, scaled by one factor to the limits.
      A command that is not finite counts as zero.
    - `point` (3,): position of the hand at the last step [m, world]. The limits apply at the hand
      for all policies, whichever point a policy commands.

    The policy's state is this system's abstract state.

    Args:
        policy: The policy.
        num_points: N, number of points.
        max_angular_speed: Limit of the hand's angular speed [rad/s].
        max_linear_speed: Limit of the hand's speed [m/s].
    """

    def __init__(
        self, *, policy: Policy, num_points: int, max_angular_speed: float, max_linear_speed: float
    ):
        super().__init__()
        self._policy = policy
        self._limits = (max_angular_speed, max_linear_speed)
        self._points = self.DeclareVectorInputPort("points", 3 * num_points)
        self._confidence = self.DeclareVectorInputPort("confidence", num_points)
        self._pose = self.DeclareVectorInputPort("object_pose", 16)
        self._hand = self.DeclareVectorInputPort("hand_pose", 16)
        at_rest = CommandedTwist(np.zeros(6), np.zeros(3))
        self._state = self.DeclareAbstractState(Value((policy.start(), at_rest)))
        ticket = {self.abstract_state_ticket(self._state)}
        for name, size in (("twist", 6), ("point", 3)):
            self.DeclareVectorOutputPort(name, size, partial(self._calc, name), ticket)
        self.DeclarePeriodicUnrestrictedUpdateEvent(policy.period, 0.0, self._step)

    def GetNote(self, context: Context) -> str:
        """Returns the policy's remark on its state in this system's context."""
        return self._policy.note(context.get_abstract_state(self._state).get_value()[0])

    def _step(self, context: Context, state: State) -> None:
        before, _ = context.get_abstract_state(self._state).get_value()
        observation = Observation(
            time=context.get_time(),
            points=self._points.Eval(context).reshape(-1, 3),
            confidence=self._confidence.Eval(context),
            X_WO=self._pose.Eval(context).reshape(4, 4),
            X_WH=self._hand.Eval(context).reshape(4, 4),
        )
        after, (V, point) = self._policy.step(before, observation)
        hand = observation.X_WH[:3, 3]
        command = CommandedTwist(scale_twist(shift_twist(V, hand - point), *self._limits), hand)
        state.get_mutable_abstract_state(self._state).set_value((after, command))

    def _calc(self, port: str, context: Context, output: BasicVector) -> None:
        _, command = context.get_abstract_state(self._state).get_value()
        output.SetFromVector(command.V if port == "twist" else command.point)

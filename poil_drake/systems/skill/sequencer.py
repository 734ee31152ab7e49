"""Takes the skill from phase to phase."""

import math
from collections.abc import Callable
from operator import itemgetter

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import (
    HOLDING,
    Observation,
    Phase,
    SkillConfig,
    SkillState,
    hand_width_of,
    next_state,
)
from poil_drake.systems.statuses import ControllerStatus, IkStatus, TrackerStatus

_INPUTS = {
    "tracker_status": 1,
    "controller_status": 1,
    "tau": 1,
    "mean_error": 1,
    "goal_error": 1,
    "motion_done": 1,
    "ik_status": 1,
    "hand.width_measured": 1,
    "safety_fault": 1,
}
_PHASE, _PHASE_START, _FAULT, _DETECT_REQUESTS, _FAULT_WIDTH = map(
    SkillState._fields.index,
    ("phase", "phase_start", "fault", "detect_requests", "fault_width"),
)
_IN_FAULT = float(Phase.FAULT)
# Looking a member up in its class at every tick takes longer than the comparison.
_FOLLOW = float(Phase.FOLLOW)
_TRACKING = float(TrackerStatus.TRACKING)
_AT_GOAL, _POINTS_LOST = float(ControllerStatus.GOAL), float(ControllerStatus.LOST)
_STUCK = float(IkStatus.STUCK)
_SAFE = float(SafetyFault.NONE)


class SkillSequencer(LeafSystem):
    """A state machine that takes the skill from waiting through grasp and goal to the retreat.

    .. pydrake_system::

        name: SkillSequencer
        input_ports:
        - tracker_status
        - controller_status
        - tau
        - mean_error
        - goal_error
        - motion_done
        - ik_status
        - hand.width_measured
        - safety_fault
        output_ports:
        - phase
        - phase_start
        - fault
        - hand.width
        - holding
        - detect_request

    Every output is a function of the state alone. Before the first update the phase is WAIT, the
    hand is opened to the pre-grasp width, nothing is held and nothing was requested. A NaN in
    `tau` or an error counts as no progress; a NaN in the hand's width, or a `safety_fault` that is
    not zero (a `SafetyFault`, or NaN), is a fault. The controller's inputs are looked at in the
    phase FOLLOW only. `phase` is an index into `poil_drake.systems.skill.phases.Phase`, `fault`
    into `Fault`. `hand.width` [m] is the opening to command, which a fault leaves as it was;
    `holding` is 1 while the object moves with the gripper, `detect_request` counts how often the
    part detector was asked to look again.
    """

    def __init__(self, *, config: SkillConfig, period: float, stopwatch: Stopwatch | None = None):
        """Constructs the sequencer.

        Args:
            config: Thresholds and times of the skill.
            period: The control period [s].
            stopwatch: Where to note how long updates take, under "control".
        """
        super().__init__()
        self._stopwatch = stopwatch or Stopwatch()
        self._config = config
        self._inputs = {
            name: self.DeclareVectorInputPort(name, size) for name, size in _INPUTS.items()
        }
        index = self.DeclareDiscreteState(np.array(SkillState()))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        width = {float(phase): hand_width_of(phase, config) for phase in Phase}
        holding = {float(phase): float(phase in HOLDING) for phase in Phase}
        outputs: dict[str, Callable[[np.ndarray], float]] = {
            "phase": itemgetter(_PHASE),
            "phase_start": itemgetter(_PHASE_START),
            "fault": itemgetter(_FAULT),
            "hand.width": lambda state: (
                state[_FAULT_WIDTH] if state[_PHASE] == _IN_FAULT else width[state[_PHASE]]
            ),
            "holding": lambda state: holding[state[_PHASE]],
            "detect_request": itemgetter(_DETECT_REQUESTS),
        }
        for name, function in outputs.items():
            self.DeclareVectorOutputPort(
                name,
                1,
                lambda context, output, function=function: self._calc(context, output, function),
                {self.discrete_state_ticket(index)},
            )

    def skill_state(self, context: Context) -> SkillState:
        """Returns the sequencer's memory in its own `context`."""
        return SkillState(*context.get_discrete_state_vector().value().tolist())

    def _calc(
        self, context: Context, output: BasicVector, function: Callable[[np.ndarray], float]
    ) -> None:
        output.SetAtIndex(0, function(context.get_discrete_state_vector().value()))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        with self._stopwatch.measure("control"):
            memory = discrete_state.get_mutable_value()
            memory[:] = self._next(context, SkillState(*memory.tolist()))

    def _next(self, context: Context, state: SkillState) -> SkillState:
        following = state.phase == _FOLLOW
        (width,) = self._eval(context, "hand.width_measured")
        # What only one phase asks for is not computed in the others.
        controller = tau = error = goal_error = math.nan
        if following:
            (controller,) = self._eval(context, "controller_status")
            (tau,), (error,) = self._eval(context, "tau"), self._eval(context, "mean_error")
            (goal_error,) = self._eval(context, "goal_error")
        seen = Observation(
            time=context.get_time(),
            tracking=self._eval(context, "tracker_status")[0] == _TRACKING,
            at_goal=controller == _AT_GOAL,
            points_lost=controller == _POINTS_LOST,
            tau=tau,
            mean_error=error,
            goal_error=goal_error,
            motion_done=self._eval(context, "motion_done")[0] > 0.5,
            ik_stuck=self._eval(context, "ik_status")[0] == _STUCK,
            hand_width=width,
            safe=self._eval(context, "safety_fault")[0] == _SAFE,
        )
        return next_state(state, seen, self._config)

    def _eval(self, context: Context, name: str) -> list[float]:
        return self._inputs[name].Eval(context).tolist()

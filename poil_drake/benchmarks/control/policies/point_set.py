"""Point-set BCSDM as two policies of the control study: the field alone, and with safe entry."""

from typing import NamedTuple

import numpy as np

from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation, Policy
from poil_drake.control.entry.entry_monitor import EntryMonitorConfig, EntryState, safe_entry_step
from poil_drake.control.entry.safe_entry import SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import (
    BcsdmConfig,
    BcsdmOutput,
    BcsdmStatus,
    point_set_bcsdm,
)
from poil_drake.control.reference.point_trajectory import PointTrajectory


class FieldPolicy(Policy):
    """Follows the field of POIL, which uses only the points.

    Args:
        reference: The demonstrated motion of the points.
        config: Parameters of the field.
    """

    def __init__(self, reference: PointTrajectory, config: BcsdmConfig):
        self._reference, self._config = reference, config

    def step(
        self, state: float | None, observation: Observation
    ) -> tuple[float | None, CommandedTwist]:
        """Returns the closest time on the reference [s] and the twist.

        If the points are lost, returns `state` unchanged and a zero twist.
        """
        output = point_set_bcsdm(
            observation.points,
            self._reference,
            self._config,
            observation.confidence,
            previous_tau=state,
        )
        tau = state if output.status is BcsdmStatus.LOST else output.tau
        return tau, _command(output)


class EntryPolicyState(NamedTuple):
    """The state of the entry monitor."""

    entry: EntryState

    @property
    def note(self) -> str:
        """The kind of the planned entry, the number of plans, and the monitor's status."""
        plan = self.entry.plan
        kind = "none" if plan is None else plan.kind.name.lower()
        return f"{kind}, {self.entry.replans} plans, {self.entry.status.name.lower()}"


class SafeEntryPolicy(Policy):
    """Follows a collision-free path onto the reference, and then the field of POIL.

    Args:
        planner: Planner for the reference, the scene and the object's shape.
        config: When to plan again.
    """

    def __init__(self, planner: SafeEntryPlanner, config: EntryMonitorConfig):
        self._planner, self._config = planner, config

    def start(self) -> EntryPolicyState:
        """Returns the state before the first plan."""
        return EntryPolicyState(EntryState())

    def step(
        self, state: EntryPolicyState, observation: Observation
    ) -> tuple[EntryPolicyState, CommandedTwist]:
        """Returns the next state and the twist that follows the plan. It is zero without a plan."""
        entry = safe_entry_step(
            state.entry,
            observation.points,
            observation.time,
            self._planner,
            self._config,
            observation.confidence,
        )
        return EntryPolicyState(entry), _command(entry.output)


def _command(output: BcsdmOutput | None) -> CommandedTwist:
    """Returns the field's twist; a zero twist for None or if the points are lost."""
    if output is None or output.status is BcsdmStatus.LOST:
        return CommandedTwist(np.zeros(6), np.zeros(3))
    return CommandedTwist(output.twist, output.centroid)

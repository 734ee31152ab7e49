"""Point-set BCSDM with safe entry as a policy of the control study."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation
from poil_drake.control.entry.entry_monitor import EntryMonitorConfig, EntryState, safe_entry_step
from poil_drake.control.entry.safe_entry import SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import BcsdmStatus


@dataclass(frozen=True, eq=False)
class EntryPolicyState:
    """The monitor's state."""

    entry: EntryState = field(default_factory=EntryState)

    @property
    def note(self) -> str:
        """What kind of entry it was, and how many plans were made."""
        plan = self.entry.plan
        kind = "none" if plan is None else plan.kind.name.lower()
        return f"{kind}, {self.entry.replans} plans, {self.entry.status.name.lower()}"


class SafeEntryPolicy:
    """The field of POIL behind a collision-free way onto the reference."""

    def __init__(
        self,
        planner: SafeEntryPlanner,
        *,
        period: float,
        config: EntryMonitorConfig | None = None,
    ):
        """Keeps the planner, which never changes.

        Args:
            planner: Of the reference, the scene and the object's shape.
            period: [s].
            config: When to plan again.
        """
        self.period = period
        self._planner = planner
        self._config = config or EntryMonitorConfig()

    def start(self) -> EntryPolicyState:
        """Returns the state before anything is planned."""
        return EntryPolicyState()

    def step(
        self, state: EntryPolicyState, observation: Observation
    ) -> tuple[EntryPolicyState, CommandedTwist]:
        """Returns the state of the entry, and the twist along its plan; zero while it holds."""
        entry = safe_entry_step(
            state.entry,
            observation.points,
            observation.time,
            self._planner,
            self._config,
            observation.confidence,
        )
        state = EntryPolicyState(entry)
        output = entry.output
        if output is None or output.status is BcsdmStatus.LOST:
            return state, CommandedTwist(np.zeros(6), np.zeros(3))
        return state, CommandedTwist(output.twist, output.centroid)

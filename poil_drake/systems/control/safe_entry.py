"""Gives the controller a reference that is safe to follow from where the object is."""

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.control.entry.entry_monitor import safe_entry_step
from poil_drake.control.entry.entry_state import EntryMonitorConfig, EntryState
from poil_drake.control.entry.safe_entry import SafeEntryPlanner
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.control.point_set_bcsdm import PointSetBcsdmConfig, confidence_in_workspace


class SafeEntry(LeafSystem):
    """Plans a collision-free way onto the demonstration, and another after a push or a slip.

    .. pydrake_system::

        name: SafeEntry
        input_ports:
        - points
        - confidence
        output_ports:
        - reference
        - status

    Inputs: `points` (3N,) row-major [m, world], NaN where not observed, and `confidence` (N,).
    Points outside of the controller's workspace count for nothing. The mathematics is in
    `safe_entry_step`, which runs once every period, in an unrestricted update. So does the
    controller's memory, and all updates of one instant read the state from before it: commands
    computed from that instant on follow the new plan, while the controller remembers a closest
    configuration on it from its next update on, and until then looks for it in the whole plan.
    Planning happens within the update and the loop waits for it: tens of milliseconds where there
    is a way, some seconds where there is none.

    Every output is a function of the state alone:

    - `reference`: a `PointTrajectory` for the port of the same name of `PointSetBcsdm`, whose field
      should be the planner's. The object changes with each plan. `ABSENT` where the object should
      stand still: before the first three points, while it is off its way, while there is no way.
    - `status` (1,): an `EntryStatus`; WAITING before the first three points. While it is FAILED
      and the fallback is the paper's field, the reference is the demonstration, for a controller
      whose field is the one that the planner was given.

    Points that are lost, stale or NaN later on leave both outputs as they are.
    """

    def __init__(
        self,
        *,
        planner: SafeEntryPlanner,
        period: float,
        config: EntryMonitorConfig | None = None,
        controller: PointSetBcsdmConfig | None = None,
    ):
        """Constructs the system.

        Args:
            planner: Of the reference, the scene and the object's shape.
            period: The control period [s].
            config: When to plan again.
            controller: Parameters of the controller that follows, for its workspace; None for the
                defaults.
        """
        super().__init__()
        self._planner = planner
        self._config = config or EntryMonitorConfig()
        self._controller = controller or PointSetBcsdmConfig()
        n = planner.model.reference.positions.shape[1]
        self._points = self.DeclareVectorInputPort("points", 3 * n)
        self._confidence = self.DeclareVectorInputPort("confidence", n)
        self._state = self.DeclareAbstractState(Value(EntryState()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        known = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "reference", lambda: Value(ABSENT), self._calc_reference, known
        )
        self.DeclareVectorOutputPort("status", 1, self._calc_status, known)

    def _entry(self, context: Context) -> EntryState:
        return context.get_abstract_state(self._state).get_value()

    def _calc_reference(self, context: Context, output: AbstractValue) -> None:
        reference = self._entry(context).reference
        output.set_value(ABSENT if reference is None else reference)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._entry(context).status)])

    def _update(self, context: Context, state: State) -> None:
        points = self._points.Eval(context).reshape(-1, 3)
        confidence = self._confidence.Eval(context)
        entry = safe_entry_step(
            self._entry(context),
            points,
            context.get_time(),
            self._planner,
            self._config,
            confidence_in_workspace(points, confidence, self._controller),
        )
        state.get_mutable_abstract_state(self._state).set_value(entry)

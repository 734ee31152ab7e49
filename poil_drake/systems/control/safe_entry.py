"""Gives the controller a reference that is safe to follow from the object's present pose."""

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.control.entry.entry_monitor import safe_entry_step
from poil_drake.control.entry.entry_state import EntryMonitorConfig, EntryState
from poil_drake.control.entry.safe_entry import SafeEntryPlanner
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.control.point_set_bcsdm import PointSetBcsdmConfig, confidence_in_workspace
from poil_drake.systems.control_period import CONTROL_PERIOD


class SafeEntry(LeafSystem):
    """Plans a collision-free path onto the demonstration, and replans after a push or a slip.

    .. pydrake_system::

        name: SafeEntry
        input_ports:
        - points
        - confidence
        output_ports:
        - reference
        - status

    Inputs: `points` (3N,) row-major [m, world], NaN where not observed, and `confidence` (N,).
    Points outside the controller's workspace are ignored. The mathematics is in `safe_entry_step`,
    which runs once per period, in an unrestricted update. Planning blocks the update: for tens of
    milliseconds if there is a path, for a few seconds if there is none.

    Every output is a function of the state alone:

    - `reference`: a `PointTrajectory` for the port `reference` of a `PointSetBcsdm`, whose
      `BcsdmConfig` must be the planner's. Each plan is a new object. `reference` is `ABSENT` while
      the object should rest: before three points have been observed, while the object is off its
      path, and while there is no path.
    - `status` (1,): an `EntryStatus`; WAITING before three points have been observed. While the
      status is FAILED and the config's fallback is "field", `reference` is the demonstration.

    When points become lost, stale or NaN, `reference` and `status` stay unchanged.
    """

    def __init__(
        self,
        *,
        planner: SafeEntryPlanner,
        period: float = CONTROL_PERIOD,
        config: EntryMonitorConfig | None = None,
        controller: PointSetBcsdmConfig | None = None,
    ):
        """Constructs the system.

        Args:
            planner: The planner for the reference, the scene and the object's shape.
            period: The control period [s].
            config: When to replan.
            controller: Parameters of the controller, of which only the workspace is used.
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

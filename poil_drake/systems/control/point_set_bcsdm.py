"""The Point-set BCSDM controller: from point positions to the gripper's velocity."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydrake.common.value import Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    LeafSystem,
    State,
    ValueProducer,
)

from poil_drake.control.field.point_set_bcsdm import (
    BcsdmConfig,
    BcsdmOutput,
    BcsdmStatus,
    point_set_bcsdm,
)
from poil_drake.control.field.twist_fit import scale_twist, shift_twist
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.statuses import ControllerStatus


@dataclass(frozen=True, kw_only=True)
class PointSetBcsdmConfig:
    """Parameters of the field, and limits of the hand's motion.

    Attributes:
        bcsdm: Parameters of the velocity field.
        max_angular_speed: Largest angular speed of the hand and the object [rad/s].
        max_linear_speed: Largest speed of the gripper and of the points' centroid [m/s].
        workspace_lower: Lower corner of the workspace [m, world]. Points outside the workspace
            are ignored as tracking errors. Its bottom is below the table top (z = 0), because depth
            cameras err by a few centimetres.
        workspace_upper: Upper corner of the workspace [m, world]; the Panda reaches 0.855 m.
    """

    bcsdm: BcsdmConfig = field(default_factory=BcsdmConfig)
    max_angular_speed: float = 1.5
    max_linear_speed: float = 0.3
    workspace_lower: tuple[float, float, float] = (-0.2, -0.9, -0.05)
    workspace_upper: tuple[float, float, float] = (1.0, 0.9, 1.3)


class ControllerAnswer(NamedTuple):
    """The result of `gripper_velocity`.

    Attributes:
        V_WG: (6,) (ω [rad/s], v [m/s]) of the gripper frame, in the world.
        status: The controller's status.
        output: The velocity field at the points.
    """

    V_WG: np.ndarray
    status: ControllerStatus
    output: BcsdmOutput


def confidence_in_workspace(
    points: np.ndarray, confidence: np.ndarray, config: PointSetBcsdmConfig
) -> np.ndarray:
    """Returns `confidence` (N,), but zero for `points` (N, 3) [m, world] outside the workspace."""
    inside = (points >= config.workspace_lower) & (points <= config.workspace_upper)
    return confidence if inside.all() else np.where(inside.all(axis=1), confidence, 0.0)


def gripper_velocity(
    points: np.ndarray,
    confidence: np.ndarray,
    X_WG: np.ndarray,
    reference: PointTrajectory,
    config: PointSetBcsdmConfig,
    previous_tau: float | None = None,
) -> ControllerAnswer:
    """Returns the gripper's spatial velocity that drives the points along the reference.

    The field gives a twist of the object at the points' centroid. The twist is scaled to the speed
    limits, shifted to the gripper frame's origin, and scaled again. Scaling keeps its direction.

    Args:
        points: (N, 3) positions [m, world]; NaN where not observed.
        confidence: (N,) weights in [0, 1].
        X_WG: (4, 4) pose of the gripper frame.
        reference: The reference motion of the same points.
        config: The field and the limits.
        previous_tau: The field's `tau` [s] in the last period, for the progress window of
            `BcsdmConfig`; None for no window.
    """
    confidence = confidence_in_workspace(points, confidence, config)
    output = point_set_bcsdm(points, reference, config.bcsdm, confidence, previous_tau)
    if output.status is BcsdmStatus.LOST:
        return ControllerAnswer(np.zeros(6), ControllerStatus.LOST, output)
    if not np.isfinite(X_WG).all():
        return ControllerAnswer(np.zeros(6), ControllerStatus.INVALID_INPUT, output)
    limits = (config.max_angular_speed, config.max_linear_speed)
    wanted = output.twist
    V_WP = scale_twist(wanted, *limits)
    V_WG_shifted = shift_twist(V_WP, X_WG[:3, 3] - output.centroid)
    V_WG = scale_twist(V_WG_shifted, *limits)
    if output.status is BcsdmStatus.GOAL:
        status = ControllerStatus.GOAL
    elif (wanted == V_WP).all() and (V_WG_shifted == V_WG).all():
        status = ControllerStatus.OK
    else:
        status = ControllerStatus.LIMITED
    return ControllerAnswer(V_WG, status, output)


class PointSetBcsdm(LeafSystem):
    """Evaluates POIL's closed-loop velocity field (section III-B) at the tracked points.

    .. pydrake_system::

        name: PointSetBcsdm
        input_ports:
        - points
        - confidence
        - gripper_pose
        - reference
        output_ports:
        - spatial_velocity
        - tau
        - potential
        - mean_error
        - goal_error
        - status
        - target_points

    Inputs: `points` (3N,) row-major [m, world], `confidence` (N,), `gripper_pose` (16,) X_WG
    row-major, and the optional `reference`: a `PointTrajectory` replaces the constructor's, and
    `ABSENT` commands rest. The mathematics is in `gripper_velocity`. All outputs come from one
    computation and have direct feedthrough:

    - `spatial_velocity` (6,): (ω [rad/s], v [m/s]) of the gripper frame in the world.
    - `tau` (1,): time of the reference's closest configuration [s].
    - `potential` (1,): D of POIL eq. 4 [m^2].
    - `mean_error` (1,): mean distance of the points to the closest configuration [m].
    - `goal_error` (1,): mean distance of the points to the reference's end [m].
    - `status` (1,): a `ControllerStatus`.
    - `target_points` (3N,): the closest configuration, row-major [m, world].

    The velocity is zero in three cases. The first that applies determines the status:

    - LOST: there are no 3 non-collinear points that are finite, inside the workspace and of
      positive confidence, e.g. before the first track. The other outputs are NaN.
    - HOLDING: `reference` is `ABSENT`. The other outputs refer to the constructor's reference.
    - INVALID_INPUT: the gripper pose is not finite.

    The system has state only if the field has a progress window: the last finite `tau` and its
    reference, which are kept while `reference` is `ABSENT`.
    """

    def __init__(
        self,
        *,
        reference: PointTrajectory,
        period: float = CONTROL_PERIOD,
        config: PointSetBcsdmConfig | None = None,
    ):
        """Constructs the controller.

        Args:
            reference: The motion of the points.
            period: The control period [s].
            config: The field and the limits.
        """
        super().__init__()
        self._reference = reference
        self._config = config or PointSetBcsdmConfig()
        n = reference.positions.shape[1]
        self._points = self.DeclareVectorInputPort("points", 3 * n)
        self._confidence = self.DeclareVectorInputPort("confidence", n)
        self._gripper = self.DeclareVectorInputPort("gripper_pose", 16)
        self._given = self.DeclareAbstractInputPort("reference", Value(ABSENT))
        prerequisites = {self.all_input_ports_ticket()}
        self._windowed = self._config.bcsdm.progress_window is not None
        if self._windowed:
            # The last finite tau, and its reference.
            self._memory = self.DeclareAbstractState(Value[object]((np.nan, None)))
            prerequisites.add(self.abstract_state_ticket(self._memory))
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._remember_tau)
        self._answer = self.DeclareCacheEntry(
            "answer",
            ValueProducer(allocate=Value(object()).Clone, calc=self._calc_answer),
            prerequisites,
        )
        outputs: dict[str, tuple[int, Callable[[ControllerAnswer], npt.ArrayLike]]] = {
            "spatial_velocity": (6, lambda answer: answer.V_WG),
            "tau": (1, lambda answer: [answer.output.tau]),
            "potential": (1, lambda answer: [answer.output.potential]),
            "mean_error": (1, lambda answer: [answer.output.mean_error]),
            "goal_error": (1, lambda answer: [answer.output.goal_error]),
            "status": (1, lambda answer: [float(answer.status)]),
            "target_points": (3 * n, lambda answer: answer.output.target_points.ravel()),
        }
        for name, (size, select) in outputs.items():

            def calc(
                context: Context,
                output: BasicVector,
                select: Callable[[ControllerAnswer], npt.ArrayLike] = select,
            ) -> None:
                output.SetFromVector(select(self._answer.Eval(context)))

            self.DeclareVectorOutputPort(name, size, calc, {self._answer.ticket()})

    def _reference_to_follow(self, context: Context) -> PointTrajectory | None:
        """Returns the reference to follow, or None if the object should rest."""
        given = self._given.Eval(context) if self._given.HasValue(context) else self._reference
        return None if given is ABSENT else given

    def _calc_answer(self, context: Context, cache: Value) -> None:
        followed = self._reference_to_follow(context)
        reference = self._reference if followed is None else followed
        previous_tau = None
        if self._windowed:
            tau, remembered = context.get_abstract_state(self._memory).get_value()
            previous_tau = tau if remembered is reference else None
        answer = gripper_velocity(
            self._points.Eval(context).reshape(-1, 3),
            self._confidence.Eval(context),
            self._gripper.Eval(context).reshape(4, 4),
            reference,
            self._config,
            previous_tau,
        )
        if followed is None and answer.status is not ControllerStatus.LOST:
            answer = answer._replace(V_WG=np.zeros(6), status=ControllerStatus.HOLDING)
        cache.set_value(answer)

    def _remember_tau(self, context: Context, state: State) -> None:
        followed = self._reference_to_follow(context)
        tau = self._answer.Eval(context).output.tau
        if followed is not None and np.isfinite(tau):
            state.get_mutable_abstract_state(self._memory).set_value((tau, followed))

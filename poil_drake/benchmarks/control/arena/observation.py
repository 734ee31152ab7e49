"""What the policies observe: the true points, or those of a slow, delayed and noisy tracker."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.geometry.rigid_transform import inverse, transform_points


class PointObserver(LeafSystem):
    """Outputs the true points and the true pose of the object.

    .. pydrake_system::

        name: PointObserver
        input_ports:
        - body_poses
        output_ports:
        - points
        - confidence
        - object_pose

    Outputs follow the plant's `body_poses` without delay: `points` (3N,) row-major [m, world],
    `confidence` (N,), all ones, and `object_pose` (16,), the row-major X_WO of the driven body.

    Args:
        plant: The finalized plant.
        body: The driven body.
        carriers: For each of the N points, the body that carries it.
        p_BP: (N, 3) the points, each in the frame of its carrier [m].
    """

    def __init__(
        self, *, plant: MultibodyPlant, body: RigidBody, carriers: list[RigidBody], p_BP: np.ndarray
    ):
        super().__init__()
        self._body = body.index()
        self._points = [(body.index(), p) for body, p in zip(carriers, p_BP, strict=True)]
        poses = [RigidTransform()] * plant.num_bodies()
        self._poses = self.DeclareAbstractInputPort("body_poses", Value(poses))
        ticket = {self._poses.ticket()}
        n = len(p_BP)
        self.DeclareVectorOutputPort("points", 3 * n, self._calc_points, ticket)
        self.DeclareVectorOutputPort(
            "confidence",
            n,
            lambda context, output: output.SetFromVector(np.ones(n)),
            {self.nothing_ticket()},
        )
        self.DeclareVectorOutputPort("object_pose", 16, self._calc_pose, ticket)

    def _calc_points(self, context: Context, output: BasicVector) -> None:
        poses = self._poses.Eval(context)
        output.SetFromVector(np.concatenate([poses[body] @ p for body, p in self._points]))

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._poses.Eval(context)[self._body].GetAsMatrix4().ravel())


@dataclass(frozen=True, kw_only=True)
class TrackingConfig:
    """The rate, latency and noise of the tracker.

    Attributes:
        period: Time between two captures [s].
        latency: Time from a capture to its result [s], shorter than `period`; rounded up to a
            multiple of `control_period`.
        noise: Standard deviation of the noise in each coordinate [m].
        control_period: Period at which the points are moved with the hand [s].
    """

    period: float = 1 / 8
    latency: float = 0.1
    noise: float = 0.003
    control_period: float = 1 / 64


class DelayedTracking(LeafSystem):
    """Tracks points like a real tracker, and propagates them to the present with the hand's motion.

    .. pydrake_system::

        name: DelayedTracking
        input_ports:
        - points
        - hand_pose
        output_ports:
        - points
        - confidence

    Inputs: the true `points` (3N,) row-major [m, world] and `hand_pose` (16,) X_WH row-major, as
    known from forward kinematics. Outputs are discrete state: `points` (3N,), NaN before the first
    result; `confidence` (N,), zero before the first result and one from then on. Points are
    propagated as by `FkPropagator`: those captured at t_c are at X_WH(t) X_WH(t_c)^-1 p(t_c) now,
    so that slip in the hand becomes visible only after the tracker's delay.

    Numeric parameter 0, (1,), is the seed of the noise.

    Args:
        num_points: N, number of points.
        config: Rate, latency and noise of the tracker.
    """

    def __init__(self, *, num_points: int, config: TrackingConfig):
        super().__init__()
        self._config = c = config
        n = 3 * num_points
        self._points = self.DeclareVectorInputPort("points", n)
        self._hand = self.DeclareVectorInputPort("hand_pose", 16)
        initial = {
            "points": np.full(n, np.nan),
            "confidence": np.zeros(num_points),
            # The last capture and the last result, each in the hand frame at its capture.
            "captured": np.full(n, np.nan),
            "track": np.full(n, np.nan),
        }
        self._state = {name: self.DeclareDiscreteState(value) for name, value in initial.items()}
        for name in ("points", "confidence"):
            self.DeclareStateOutputPort(name, self._state[name])
        self._seed = self.DeclareNumericParameter(BasicVector([0.0]))
        self._ticks = round(c.period / c.control_period)
        self._delay = math.ceil(c.latency / c.control_period - 1e-9)
        self.DeclarePeriodicDiscreteUpdateEvent(c.control_period, 0.0, self._update)

    def SetSeed(self, context: Context, seed: int) -> None:
        """Seeds the noise in this system's context."""
        context.get_mutable_numeric_parameter(self._seed).SetFromVector([float(seed)])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        def state(name: str) -> np.ndarray:
            return discrete_state.get_mutable_value(self._state[name])

        c = self._config
        tick = round(context.get_time() / c.control_period)
        X_WH = self._hand.Eval(context).reshape(4, 4)
        if tick >= self._delay and (tick - self._delay) % self._ticks == 0:
            state("track")[:] = state("captured")
            state("confidence")[:] = 1.0
        if tick % self._ticks == 0:
            seed = int(context.get_numeric_parameter(self._seed).value()[0])
            rng = np.random.default_rng([seed, tick])
            true = self._points.Eval(context)
            points = true + c.noise * rng.standard_normal(true.size)
            state("captured")[:] = transform_points(inverse(X_WH), points.reshape(-1, 3)).ravel()
        state("points")[:] = transform_points(X_WH, state("track").reshape(-1, 3)).ravel()

"""A point tracker that is slow, late and noisy, carried along with the hand in between."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.systems.propagation.motion_history import empty_history, motion_at, record_motion


@dataclass(frozen=True, kw_only=True)
class TrackingConfig:
    """How good the tracker is.

    Attributes:
        period: Between two captures [s].
        latency: From a capture until its result is there [s]; rounded up to the control period, and
            shorter than `period`.
        noise: Standard deviation of each coordinate [m].
        control_period: Of the propagation [s].
    """

    period: float = 1 / 8
    latency: float = 0.1
    noise: float = 0.003
    control_period: float = 1 / 64

    def __post_init__(self) -> None:
        if not 0.0 <= self.latency < self.period:
            raise InvalidValueError(
                f"TrackingConfig.latency is {self.latency} s, the period {self.period} s.",
                remedy="Pass a latency that is not negative and shorter than the period.",
            )


class DelayedTracking(LeafSystem):
    """Shows the points as a tracker would, brought up to now by the hand's motion.

    .. pydrake_system::

        name: DelayedTracking
        input_ports:
        - points
        - hand_pose
        output_ports:
        - points
        - confidence

    Inputs: the true `points` (3N,) row-major [m, world] and `hand_pose` (16,) X_WH row-major, which
    is what forward kinematics says. Outputs are discrete state: `points` (3N,), NaN before the
    first result; `confidence` (N,), zero until then, one after that. The propagation is that of
    `FkPropagator`: points captured at t_c are at X_WH(t) X_WH(t_c)^-1 p(t_c), so a slip in the hand
    shows with the tracker's delay only.

    The parameter of index 0 (1,) seeds the noise.
    """

    def __init__(self, *, num_points: int, config: TrackingConfig | None = None):
        """Constructs the tracker.

        Args:
            num_points: N.
            config: Rate, latency, noise.
        """
        super().__init__()
        self._config = c = config or TrackingConfig()
        n = 3 * num_points
        self._points = self.DeclareVectorInputPort("points", n)
        self._hand = self.DeclareVectorInputPort("hand_pose", 16)
        history = empty_history(c.period + c.latency, c.control_period)
        initial = {
            "points": np.full(n, np.nan),
            "confidence": np.zeros(num_points),
            # Captured, and not yet there; then the same with the hand's motion undone.
            "captured": np.full(n, np.nan),
            "track": np.full(n, np.nan),
            "history": history.ravel(),
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

        c, time = self._config, context.get_time()
        tick = round(time / c.control_period)
        X_WH = self._hand.Eval(context).reshape(4, 4)
        history = state("history").reshape(-1, 17)
        record_motion(history, time, X_WH, c.control_period)
        since = (tick - self._delay) % self._ticks
        if since == 0 and tick >= self._delay:
            then = motion_at(history, time - self._delay * c.control_period, c.control_period)
            if then is not None:
                captured = state("captured").reshape(-1, 3)
                state("track")[:] = transform_points(inverse(then), captured).ravel()
                state("confidence")[:] = 1.0
        if tick % self._ticks == 0:
            seed = int(context.get_numeric_parameter(self._seed).value()[0])
            rng = np.random.default_rng([seed, tick])
            true = self._points.Eval(context)
            state("captured")[:] = true + c.noise * rng.standard_normal(true.size)
        state("points")[:] = transform_points(X_WH, state("track").reshape(-1, 3)).ravel()

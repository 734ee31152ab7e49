"""Point-set BCSDM as a policy of the control study."""

import numpy as np

from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory


class FieldPolicy:
    """The field of POIL, as it is; it sees nothing but the points."""

    def __init__(
        self, reference: PointTrajectory, *, config: BcsdmConfig | None = None, period: float
    ):
        """Keeps the reference.

        Args:
            reference: Where the points should go.
            config: The field.
            period: [s].
        """
        self.period = period
        self._reference = reference
        self._config = config or BcsdmConfig()

    def start(self) -> float | None:
        """Returns the closest time of the last step, which is not known yet."""
        return None

    def step(
        self, state: float | None, observation: Observation
    ) -> tuple[float | None, CommandedTwist]:
        """Returns the closest time of the reference, and the twist there."""
        output = point_set_bcsdm(
            observation.points,
            self._reference,
            self._config,
            observation.confidence,
            previous_tau=state,
        )
        if output.status is BcsdmStatus.LOST:
            return state, CommandedTwist(np.zeros(6), np.zeros(3))
        return output.tau, CommandedTwist(output.twist, output.centroid)

"""The contents of a summary picture."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from poil_drake.reports.run_summary import PhaseSpan
from poil_drake.systems.logging.snapshot_recorder import Snapshot


@dataclass(frozen=True, eq=False, kw_only=True)
class SummaryData:
    """The contents of a summary picture. Empty fields are not drawn.

    Attributes:
        title: Name of the run, e.g. "Hang a mug".
        success: Whether the task succeeded.
        reason: Why it succeeded or failed, in one clause.
        subtitle: One line of further figures.
        times: (T,) times of the samples of points, potential, tau and joint velocities [s].
        point_errors: (T, N) distance of each point from its target [m]; NaN where unknown.
        potential: (T,) D of POIL eq. 4 [m^2].
        tau: (T,) time of the reference's closest sample [s].
        reference_duration: The reference's last time [s]; NaN if unknown.
        joint_velocities: (T, J) commanded or measured joint velocities [rad/s].
        velocity_limits: (J,) velocity limits of the joints [rad/s].
        phases: The skill's phases.
        tracking_times: (S,) times [s] of the tracker's samples.
        tracking_errors: (S, N) distance of each tracked point from the truth [m].
        snapshots: Camera pictures in order of time.
    """

    title: str
    success: bool
    reason: str
    subtitle: str = ""
    times: np.ndarray
    point_errors: np.ndarray
    potential: np.ndarray
    tau: np.ndarray
    reference_duration: float = np.nan
    joint_velocities: np.ndarray
    velocity_limits: np.ndarray
    phases: Sequence[PhaseSpan] = ()
    tracking_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    tracking_errors: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    snapshots: Sequence[Snapshot] = ()

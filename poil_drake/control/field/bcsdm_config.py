"""Parameters of the Point-set BCSDM field."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from poil_drake.control.field.twist_fit import RansacConfig
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_consensus import RigidConsensusConfig

OutlierTest = Literal["rigidity", "velocity", "none"]


@dataclass(frozen=True, kw_only=True)
class BcsdmConfig:
    """Parameters of the field.

    Attributes:
        eta: Gain of the contraction towards the reference [1/s]. 3 is the paper's.
        interpolate: Whether the closest configuration is sought between the samples too. The
            paper takes the closest sample, which makes the field jump as the sample changes.
        progress_window: How far the closest configuration is sought around that of the last tick,
            (backward, forward) [s]. None seeks it in the whole reference, as in the paper, which
            lets a disturbance move the index anywhere, and noise too where the reference comes
            near itself. The window ends at a sample or between it and the next.
        window_escape_ratio: With a window, the whole reference still wins where its potential is
            below this part of the window's: the object was carried elsewhere. 0 never leaves.
        goal_tolerance: Mean distance of the points from the reference's end that counts as there
            [m]. 3 mm is about a tracker's noise over ten points plus the hand's lag.
        goal_window: The closest configuration must lie within this time of the reference's end
            [s] to count as there, so that passing by the end does not.
        min_spread: Root mean square distance of the points from the line that fits them best which
            is still enough for a rotation [m]. A mug's handle has 8 mm and more.
        min_rotation_spread: Root mean square distance of the points from an axis below which a turn
            about it is slowed instead of following their noise [m]. 0, the paper's, never does; 2
            mm keeps a tracker's noise of 1 mm over ten points below 10 deg.
        outlier_test: How points that are not where the tracker says are found and left out.
            "rigidity": those that neither the best twist nor a rigid motion to the closest
            configuration explains, see `rigid_inliers`. "velocity": by RANSAC on the velocities,
            as in the paper, which takes points far from the reference in rotation for outliers.
            "none": not at all.
        rigidity: For "rigidity".
        ransac: For "velocity".
    """

    eta: float = 3.0
    interpolate: bool = True
    progress_window: tuple[float, float] | None = None
    window_escape_ratio: float = 0.25
    goal_tolerance: float = 0.003
    goal_window: float = 0.5
    min_spread: float = 0.001
    min_rotation_spread: float = 0.0
    outlier_test: OutlierTest = "rigidity"
    rigidity: RigidConsensusConfig = field(default_factory=RigidConsensusConfig)
    ransac: RansacConfig = field(default_factory=RansacConfig)

    def __post_init__(self) -> None:
        if not self.eta > 0.0:
            raise InvalidValueError(
                f"BcsdmConfig.eta is {self.eta} / s.",
                remedy="Pass a positive gain, or the field does not converge.",
            )
        if self.outlier_test not in get_args(OutlierTest):
            raise InvalidValueError(
                f"BcsdmConfig.outlier_test is '{self.outlier_test}'.",
                remedy=f"Choose one of {', '.join(get_args(OutlierTest))}.",
            )

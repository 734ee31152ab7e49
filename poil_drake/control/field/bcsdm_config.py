"""Parameters of the Point-set BCSDM field."""

from dataclasses import dataclass
from typing import Literal, get_args

from poil_drake.errors import InvalidValueError

OutlierTest = Literal["rigidity", "velocity", "none"]


@dataclass(frozen=True, kw_only=True)
class BcsdmConfig:
    """Parameters of the field.

    Attributes:
        eta: Gain of the contraction towards the reference [1/s]. 3 is the paper's.
        interpolate: Whether the closest configuration may lie between samples. The paper takes the
            closest sample, which makes the field jump where the sample changes.
        progress_window: Search range (backward, forward) [s] for the closest configuration, around
            that of the last tick. With interpolation, the result may be up to one sample outside.
            None searches the whole reference, as in the paper. Then a disturbance can move the
            closest configuration anywhere, and so can noise where the reference comes near itself.
        window_escape_ratio: The search leaves the window if the potential D elsewhere is below this
            fraction of the smallest D in the window, because then the object has been moved. 0
            never leaves the window.
        goal_tolerance: Mean distance of the points from the reference's end below which they are
            at the goal [m]. 3 mm is about a tracker's noise over ten points plus the hand's lag.
        goal_window: At the goal the closest configuration must lie within this time of the
            reference's end [s], so that a motion that passes the goal earlier does not end there.
        min_spread: Smallest root mean square distance of the points from their best-fitting line
            that determines a rotation [m]. A mug's handle has 8 mm or more.
        min_rotation_spread: A rotation about an axis is slowed if the points' root mean square
            distance from the axis is below this [m], because noise dominates it. 0, as in the
            paper, never slows it. 2 mm keeps the effect of a tracker's noise of 1 mm over ten
            points below 10 deg.
        outlier_test: How mistracked points are found and excluded. "rigidity" excludes points that
            do not fit a rigid motion to the closest configuration, see `rigid_inliers`. "velocity"
            applies RANSAC to the velocities, as in the paper; after a large rotation away from the
            reference it takes true points for outliers. "none" keeps all points.
        inlier_distance: With "rigidity", largest distance of an inlier from where the motion puts
            it [m]. 5 mm is about five standard deviations of a tracker's noise.
        inlier_speed: With "velocity", largest residual of an inlier [m/s]. With eta = 3 / s a
            tracking error of 5 mm gives 0.015 m/s, a tracker's noise of 1 mm 0.003 m/s.
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
    inlier_distance: float = 0.005
    inlier_speed: float = 0.015

    def __post_init__(self) -> None:
        if not self.eta > 0.0:
            raise InvalidValueError(
                f"BcsdmConfig.eta is {self.eta} 1/s.",
                remedy="Pass a positive gain; otherwise the field does not converge.",
            )
        if self.outlier_test not in get_args(OutlierTest):
            raise InvalidValueError(
                f"BcsdmConfig.outlier_test is '{self.outlier_test}'.",
                remedy=f"Choose one of {', '.join(get_args(OutlierTest))}.",
            )

"""How much clearance a motion of the object must keep."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_consensus import RigidConsensusConfig


@dataclass(frozen=True, kw_only=True)
class EntryClearanceConfig:
    """What counts as too close.

    Attributes:
        margin: Clearance kept where the demonstration does not come closer itself [m]. A tracker's
            3 mm of noise turns an object of 10 cm by some 5 mm at its far side; twice that.
        tolerance: How much closer than the demonstration, or than where a motion starts, is still
            as close [m]. Clouds with 5 mm between their points say no better where they touch.
        tube_radius: Up to this far from the demonstration, or from the start, its clearance is
            enough [m, farthest point]: a narrow place may be left or passed a little aside.
        opening: Beyond, the clearance demanded grows to the margin, by this per distance.
        contact_floor: From a demonstration in contact it grows at once, to this [m]. Nearer than
            that, clouds with 4 to 6 mm between their points cannot tell touching from crossing.
        resolution: What a point of the object may move between two checks [m]; less than twice the
            margin, so that none crosses a surface unseen.
        deviations: Where the demonstration comes close, this many standard deviations of the
            object's pose are allowed for, as told by how well the points fit together. But for it,
            noise in a hole that is narrower than the noise looks like a collision.
        deformation: How far, in the mean, the points get from one rigid shape because the object
            deforms [m]. Without it, a bag that bends looks like a bag whose pose is uncertain, and
            may come as close to the scene as that.
        rigidity: Which points do not count for the object's pose. 12 mm is beyond 3 mm of noise
            on each axis, and what a bag's handle bends by.
        cloud_spacing: The object's cloud is thinned to about one point for each such cell [m].
    """

    margin: float = 0.01
    tolerance: float = 0.002
    tube_radius: float = 0.04
    opening: float = 0.5
    contact_floor: float = 0.003
    resolution: float = 0.01
    deviations: float = 2.0
    deformation: float = 0.0
    rigidity: RigidConsensusConfig = field(
        default_factory=lambda: RigidConsensusConfig(inlier_distance=0.012)
    )
    cloud_spacing: float = 0.006

    def __post_init__(self) -> None:
        if not 0.0 < self.resolution <= 2.0 * self.margin:
            raise InvalidValueError(
                f"EntryClearanceConfig has resolution={self.resolution} m and "
                f"margin={self.margin} m.",
                remedy="Check at least every twice the margin.",
            )


class EntryStart(NamedTuple):
    """Where a motion starts.

    Attributes:
        X_WB: (4, 4) pose of the object.
        clearance: Its distance to the scene's points there, at most the model's `reach` [m].
        height: Its height above the ground there [m]; infinite where there is none.
        slack: How uncertain both are, at most the margin [m].
    """

    X_WB: np.ndarray
    clearance: float
    height: float
    slack: float


def enough_clearance(
    clearance: np.ndarray,
    height: np.ndarray,
    start: EntryStart,
    *,
    left: np.ndarray,
    shown_clearances: np.ndarray,
    shown_heights: np.ndarray,
    away: np.ndarray,
    reach: float,
    config: EntryClearanceConfig,
) -> np.ndarray:
    """Returns whether poses keep the clearance demanded of a motion: (B,) bool.

    Demanded is the margin, or what the demonstration itself has nearby, less the tolerance, or what
    the start has nearby, if one of them is less. Over the ground, through which nothing slips
    unseen, an object that starts low may stay low.

    Args:
        clearance: (B,) distance to the scene's points [m].
        height: (B,) above the ground [m].
        start: Where the motion starts.
        left: (B,) how far the object gets from there [m].
        shown_clearances: (T,) distance to the scene's points along the demonstration [m].
        shown_heights: (T,) above the ground along the demonstration [m].
        away: (B, T) how far the object is from each of these poses [m].
        reach: Distance to the scene's points that makes sure of the margin [m].
        config: Margins.
    """
    spared = config.tolerance + start.slack
    near = np.minimum(
        _nearby(shown_clearances, reach, spared, away, config).min(axis=1),
        _nearby(np.asarray(start.clearance), reach, spared, left, config),
    )
    low = _nearby(shown_heights, config.margin, spared, away, config).min(axis=1)
    if start.height < config.margin:
        low = np.minimum(low, start.height - spared)
    return (clearance >= np.minimum(reach, near)) & (height >= np.minimum(config.margin, low))


def _nearby(
    clearance: np.ndarray,
    limit: float,
    spared: float,
    away: np.ndarray,
    config: EntryClearanceConfig,
) -> np.ndarray:
    """Returns what is demanded at distances from where a clearance was enough [m].

    Near a clearance that reached the limit it is infinite: there is nothing to spare.
    """
    kept = clearance - spared
    touching = np.minimum(config.contact_floor, kept + config.opening * away)
    beyond = np.maximum(away - config.tube_radius, 0.0)
    demanded = np.maximum(kept, touching) + config.opening * beyond
    return np.where(clearance >= limit, np.inf, demanded)

"""The clearance that a motion of the object must keep."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.errors import InvalidValueError

RESOLUTION = 0.01
"""Largest motion of a point of the object between two checks [m]."""

TOLERANCE = 0.002
"""A clearance this much below the demonstrated one is still enough [m]. Clouds with 5 mm between
their points do not locate contacts better."""

_CONTACT_FLOOR = 0.003
"""Around a demonstrated contact the required clearance grows to this within the tube radius [m].
Below it, clouds with 4 to 6 mm between their points do not distinguish touching from crossing."""

_GROWTH = 0.5
"""Growth of the required clearance with the distance from the demonstration [m/m]."""


@dataclass(frozen=True, kw_only=True)
class EntryClearanceConfig:
    """The required clearance.

    Attributes:
        margin: Clearance kept unless the demonstration itself comes closer [m]. 1 cm is twice the
            motion of the far side of an object of 10 cm that a tracker's noise of 3 mm causes.
        tube_radius: Up to this distance of the object's farthest point from a demonstrated pose, or
            from the start, the clearance of this pose is enough [m]. The object may therefore pass
            narrow places slightly off its path.
        deformation: Mean distance by which the object's deformation moves the points off one rigid
            shape [m]. With 0, the pose of a bag that bends seems uncertain, so the bag may come
            closer to the scene.
    """

    margin: float = 0.01
    tube_radius: float = 0.04
    deformation: float = 0.0

    def __post_init__(self) -> None:
        if not self.margin >= 0.5 * RESOLUTION:
            raise InvalidValueError(
                f"EntryClearanceConfig.margin is {self.margin} m.",
                remedy=f"Pass at least {0.5 * RESOLUTION} m: checks are {RESOLUTION} m apart.",
            )


class EntryStart(NamedTuple):
    """The object at the start of a motion.

    Attributes:
        X_WB: (4, 4) pose of the object.
        clearance: Distance from the object to the scene's points, at most `EntryModel.reach` [m].
        height: Height of the object above the ground [m]; infinite without a ground.
        uncertainty: Uncertainty of clearance and height [m], at most the margin.
    """

    X_WB: np.ndarray
    clearance: float
    height: float
    uncertainty: float


def required_clearance(
    known: np.ndarray | float,
    distances: np.ndarray,
    limit: float,
    tolerance: float,
    tube_radius: float,
) -> np.ndarray:
    """Returns the clearances [m] required at given distances from poses of known clearance.

    The required clearance is the known clearance less the tolerance. If this is below 3 mm, the
    required clearance grows with the distance up to 3 mm. Beyond the tube radius it always grows.
    The result is infinite where the known clearance reaches the limit. The caller takes the minimum
    of the results and the limit.

    Args:
        known: Clearances at the known poses [m], of any shape.
        distances: Distances of the farthest point from these poses [m]; broadcast against `known`.
        limit: The clearance that guarantees the margin [m].
        tolerance: How much less than the known clearance is enough [m].
        tube_radius: See `EntryClearanceConfig` [m].
    """
    kept = known - tolerance
    floor = np.minimum(_CONTACT_FLOOR, kept + _GROWTH * distances)
    beyond = np.maximum(distances - tube_radius, 0.0)
    return np.where(known >= limit, np.inf, np.maximum(kept, floor) + _GROWTH * beyond)

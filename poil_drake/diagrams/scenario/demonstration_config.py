"""The `poil.demonstration_motion` section of a scenario: the object's motion."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.diagrams.scenario.value_ranges import require_not_negative, require_positive
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform


@dataclass(frozen=True, kw_only=True)
class Keyframe:
    """The object's pose at one time of a demonstration.

    Attributes:
        time: Time since the start [s].
        translation: Position of the object's frame in the world [m].
        rpy: Roll, pitch and yaw of the object's frame in the world [deg].
    """

    time: float = 0.0
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> np.ndarray:
        """The (4, 4) pose of the object in the world [m]."""
        rotation = Rotation.from_euler("xyz", self.rpy, degrees=True).as_matrix()
        return make_transform(rotation, np.array(self.translation))


@dataclass(frozen=True, kw_only=True)
class HangingMotionConfig:
    """The motion that hangs a mug on a rod.

    Attributes:
        rod: Link of the fixture, or regular expression for names of its geometries; the longest
            of these geometries is the rod. The object hangs when it touches one of them; touching
            the rest of the fixture does not count.
        start: Initial position of the object [m].
        start_yaw: Initial angle of the handle from the world's x axis [deg]. At 0 both cameras see
            the handle from the side.
        tilt: Final elevation of the handle [deg]. At 45, an arm that grips the rim from above and
            hangs the mug reaches forward and down, in a comfortable posture.
        seat: Final place of the handle on the rod: 0 is the rod's base, 1 its tip. The default is
            deep enough to stay on the rod, but clear of the post.
        clearance: Final distance between rod and handle [m]; they nearly touch, as when a hand is
            about to let go.
        lift: Height by which the object is lifted first [m].
        approach: Distance from the rod's tip at which the handle is aligned with the rod [m];
            greater than half of the object's width, so that the object clears the tip.
    """

    rod: str = "rod"
    start: tuple[float, float, float] = (0.45, -0.13, 0.0)
    start_yaw: float = 0.0
    tilt: float = 45.0
    seat: float = 0.54
    clearance: float = 0.003
    lift: float = 0.12
    approach: float = 0.065

    def __post_init__(self) -> None:
        place = "poil.demonstration_motion.hanging"
        for name in ("clearance", "lift", "approach"):
            require_positive(f"{place}.{name}", getattr(self, name))
        if not 0.0 <= self.seat <= 1.0:
            raise ScenarioError(
                f"{place}.seat is {self.seat}.",
                remedy="It must lie between 0, the rod's base, and 1, its tip.",
            )


@dataclass(frozen=True, kw_only=True)
class DemonstrationMotionConfig:
    """The `poil.demonstration_motion` section: the motion of the built-in demonstration.

    Attributes:
        keyframes: Poses of the object, at least two, the first at 0 s. Without keyframes, the
            object is hung on the fixture's rod.
        blend: Time by which movements start before and end after their keyframes [s].
        hanging: The motion that hangs the object, used if there are no keyframes.
    """

    keyframes: tuple[Keyframe, ...] = ()
    blend: float = 0.2
    hanging: HangingMotionConfig = field(default_factory=HangingMotionConfig)

    def __post_init__(self) -> None:
        times = [keyframe.time for keyframe in self.keyframes]
        rising = len(times) > 1 and times[0] == 0.0 and all(a < b for a, b in pairwise(times))
        if times and not rising:
            raise ScenarioError(
                f"poil.demonstration_motion.keyframes are at {times} s.",
                remedy="Define at least two at increasing times, the first at 0.",
            )
        require_not_negative("poil.demonstration_motion.blend", self.blend)

"""The `poil.demonstration_motion` section of a scenario: the built-in demonstration."""

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
        rod: A link of the fixture, or a regular expression for names of its collision geometries.
            The object is hung on the longest of these geometries. It counts as hanging only while
            it touches one of them.
        start: Where the object stands first, x and y of its frame in the world [m]; it stands on
            `poil.table_height` unless a third number sets its frame's height. Empty: where the
            scenario's own object starts.
        start_yaw: Initial direction of the handle, from the one in which it hangs [deg]. At 0, the
            default cameras see the handle from the side.
        tilt: Final elevation of the handle above the horizontal [deg]. At 45, an arm that grips
            the rim from above ends in a comfortable posture: it reaches forward and down.
        seat: Final place of the handle along the rod, from 0 (base) to 1 (tip). At the default,
            the handle stays on the rod, and the object is clear of the rack's post.
        clearance: Final gap between rod and handle [m], just before a hand would let go.
        lift: Height by which the object is lifted first [m].
        approach: Distance of the handle from the rod's tip before the object slides onto the rod
            [m]. A value above half of the object's width keeps the object clear of the tip.
    """

    rod: str = "rod"
    start: tuple[float, ...] = ()
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
        if len(self.start) not in (0, 2, 3):
            raise ScenarioError(
                f"{place}.start is {list(self.start)}, which is not a position.",
                remedy="Use [x, y], or [x, y, z] to set the height of the object's frame as well.",
            )
        if not 0.0 <= self.seat <= 1.0:
            raise ScenarioError(
                f"{place}.seat is {self.seat}, which is not on the rod.",
                remedy="Choose a value from 0 (the rod's base) to 1 (its tip).",
            )


@dataclass(frozen=True, kw_only=True)
class DemonstrationMotionConfig:
    """The `poil.demonstration_motion` section: the motion of the built-in demonstration.

    Attributes:
        keyframes: Poses of the object at increasing times: at least two, the first at 0 s. If
            there are none, the object is hung on the fixture's rod.
        blend: How long before its first keyframe each movement between two keyframes starts, and
            how long after its second keyframe it ends [s].
        hanging: The motion that hangs the object if there are no keyframes.
    """

    keyframes: tuple[Keyframe, ...] = ()
    blend: float = 0.2
    hanging: HangingMotionConfig = field(default_factory=HangingMotionConfig)

    def __post_init__(self) -> None:
        times = [keyframe.time for keyframe in self.keyframes]
        rising = len(times) > 1 and times[0] == 0.0 and all(a < b for a, b in pairwise(times))
        if times and not rising:
            raise ScenarioError(
                f"The times of poil.demonstration_motion.keyframes are not valid: {times} s.",
                remedy="Define at least two keyframes at increasing times, the first at 0 s.",
            )
        require_not_negative("poil.demonstration_motion.blend", self.blend)

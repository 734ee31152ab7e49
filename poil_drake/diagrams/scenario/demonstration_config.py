"""How the object moves in a simulated demonstration, as the scenario says it."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform

_DURATIONS = ("rest", "lift_time", "carry_time", "slide_time", "settle_time")


@dataclass(frozen=True, kw_only=True)
class Keyframe:
    """Where the object is at one time of a demonstration.

    Attributes:
        time: Since the start [s].
        translation: Position of the object's frame in the world [m].
        rpy: Its orientation, as roll, pitch and yaw about the world's axes [deg].
    """

    time: float = 0.0
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not np.isfinite([self.time, *self.translation, *self.rpy]).all():
            raise ScenarioError(
                f"The keyframe at {self.time} s holds a value that is not finite.",
                remedy="Correct it in poil.demonstration_motion.keyframes.",
            )

    @property
    def pose(self) -> np.ndarray:
        """The (4, 4) pose of the object in the world [m]."""
        rotation = Rotation.from_euler("xyz", self.rpy, degrees=True).as_matrix()
        return make_transform(rotation, np.array(self.translation))


@dataclass(frozen=True, kw_only=True)
class HangingMotionConfig:
    """How a mug is hung on a rod.

    Attributes:
        rod: The fixture's link, or a pattern on the names of its geometries, of which the longest
            is the rod. An object hangs where it touches these, not the rest of the fixture.
        start: Where the object stands at first [m].
        start_yaw: How far its handle is turned from the world's x axis [deg]. At 0 both cameras see
            it from the side.
        tilt: How steeply the handle points upwards in the end [deg]. At 45 a mug held from above by
            its rim is held forward and downward, which suits an arm that stands behind it.
        seat: Where on the rod the handle comes to hang: 0 at its base, 1 at its tip. Far enough in
            to stay, far enough out for the mug to clear the post.
        clearance: Between rod and handle in the end [m]: they nearly touch, as when a hand is about
            to let go.
        lift: How high the object is lifted first [m].
        approach: How far before the rod's tip the handle is lined up with it [m]; more than half
            of the object's width, which is carried past the tip.
        rest: How long the object rests at the start and at the end [s], as people do.
        lift_time: Duration of lifting [s].
        carry_time: Duration of carrying, turning and tilting [s]; 3 s keep it below 1 rad/s.
        slide_time: Duration of sliding the handle over the rod [s].
        settle_time: Duration of lowering it onto the rod [s].
    """

    rod: str = "rod"
    start: tuple[float, float, float] = (0.45, -0.13, 0.0)
    start_yaw: float = 0.0
    tilt: float = 45.0
    seat: float = 0.54
    clearance: float = 0.003
    lift: float = 0.12
    approach: float = 0.065
    rest: float = 0.5
    lift_time: float = 1.0
    carry_time: float = 3.0
    slide_time: float = 1.5
    settle_time: float = 0.75

    def __post_init__(self) -> None:
        lengths = {
            name: getattr(self, name) for name in ("clearance", "lift", "approach", *_DURATIONS)
        }
        for name, value in lengths.items():
            if not 0.0 < value < np.inf:
                raise ScenarioError(
                    f"poil.demonstration_motion.hanging.{name} is {value}.",
                    remedy="It must be positive and finite.",
                )
        if not np.isfinite([*self.start, self.start_yaw, self.tilt]).all():
            raise ScenarioError(
                "poil.demonstration_motion.hanging has a start, start_yaw or tilt that is not "
                "finite.",
                remedy="Correct it.",
            )
        if not 0.0 <= self.seat <= 1.0:
            raise ScenarioError(
                f"poil.demonstration_motion.hanging.seat is {self.seat}.",
                remedy="It must lie between 0, the rod's base, and 1, its tip.",
            )


@dataclass(frozen=True, kw_only=True)
class DemonstrationMotionConfig:
    """The `poil.demonstration_motion` stanza: how the built-in demonstration goes.

    Attributes:
        keyframes: Where the object is when. Without any it is hung on the fixture's rod.
        blend: How much a movement overlaps with the next [s]; people hardly stop in between.
        hanging: How it is hung, where no keyframes are given.
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
                remedy="Give at least two at increasing times, the first at 0.",
            )
        if not 0.0 <= self.blend < np.inf:
            raise ScenarioError(
                f"poil.demonstration_motion.blend is {self.blend} s.",
                remedy="It must be finite and not negative.",
            )

"""The `poil:` stanza of a scenario: the task, and how POIL does it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from poil_drake.diagrams.scenario.demonstration_config import DemonstrationMotionConfig
from poil_drake.diagrams.scenario.hardware_config import HardwareConfig
from poil_drake.diagrams.scenario.rates import Rates
from poil_drake.errors import ScenarioError
from poil_drake.perception.depth_noise import StereoDepthNoiseConfig
from poil_drake.systems.safety.faults import SafetyConfig


@dataclass(frozen=True, kw_only=True)
class Randomization:
    """What a trial of a benchmark draws anew. An empty range leaves things as they are.

    Attributes:
        models: Model files to choose the object from, as in a directive.
        x: Lowest and highest position of the object along the world's x [m].
        y: The same along y [m].
        yaw: Lowest and highest turn about the world's z [deg].
    """

    models: tuple[str, ...] = ()
    x: tuple[float, ...] = ()
    y: tuple[float, ...] = ()
    yaw: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw"):
            value = getattr(self, name)
            if len(value) not in (0, 2) or (
                value and not -math.inf < value[0] <= value[1] < math.inf
            ):
                raise ScenarioError(
                    f"poil.randomization.{name} is {list(value)}.",
                    remedy="Write [lowest, highest], or [] to leave it as it is.",
                )


@dataclass(frozen=True, kw_only=True)
class PoilConfig:
    """The `poil:` stanza: the task, and how POIL does it.

    Attributes:
        object: Model instance of the object that is moved.
        part: Name of the functional part.
        parts: Part name -> link name, or regular expression on geometry names, of the object. A
            part that is not listed is the link of its own name.
        fixture: Model instance of what the object interacts with.
        robot: Model instance of the robot.
        table_height: Height of the plane that things stand on [m, world].
        demonstration: A recorded demonstration (.mcap), or None for the built-in one.
        demonstration_object_label: What a recording's object is called there; None: as `object`.
        demonstration_object: Model file of the object in the built-in demonstration.
        demonstration_motion: How that object moves.
        detector: Name of the part detector.
        tracker: Name of the point tracker.
        num_points: Points on the functional part, N_k in the paper.
        num_support_points: Points spread over the object, at least 4, that tell the tracker how
            much of it is seen (POIL: 40).
        eta: Attraction to the reference trajectory, η in the paper [1/s].
        max_angular_speed: Limit of the gripper's angular speed [rad/s]: the wrist's comfort.
        max_linear_speed: Limit of the gripper's linear speed [m/s]: a human pace.
        latency: From capturing images to having the tracked points [s]; the cameras' output_delay
            is a part of it.
        depth_noise: The cameras' errors.
        rates: All periods.
        randomization: What benchmark trials draw anew.
        safety: When the arm is stopped, and where and how fast it may move.
        hardware: How the real robot and its cameras are reached, and how fast it moves.
    """

    object: str = "mug"
    part: str = "handle"
    parts: Mapping[str, str] = field(default_factory=dict)
    fixture: str = "rack"
    robot: str = "panda"
    table_height: float = 0.0
    demonstration: str | None = None
    demonstration_object_label: str | None = None
    demonstration_object: str = "package://poil_drake/mugs/mug_demo/mug_demo.sdf"
    demonstration_motion: DemonstrationMotionConfig = field(
        default_factory=DemonstrationMotionConfig
    )
    detector: str = "label_image"
    tracker: str = "rigid_flow"
    num_points: int = 10
    num_support_points: int = 40
    eta: float = 3.0
    max_angular_speed: float = 1.0
    max_linear_speed: float = 0.25
    latency: float = 1 / 16
    depth_noise: StereoDepthNoiseConfig = field(default_factory=StereoDepthNoiseConfig)
    rates: Rates = field(default_factory=Rates)
    randomization: Randomization = field(default_factory=Randomization)
    hardware: HardwareConfig = field(default_factory=HardwareConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)

    def __post_init__(self) -> None:
        for name, lowest in (("num_points", 3), ("num_support_points", 4)):
            if getattr(self, name) < lowest:
                raise ScenarioError(
                    f"poil.{name} is {getattr(self, name)}.",
                    remedy=f"It must be at least {lowest}.",
                )
        for name in ("eta", "max_angular_speed", "max_linear_speed"):
            if not 0 < getattr(self, name) < math.inf:
                raise ScenarioError(
                    f"poil.{name} is {getattr(self, name)}.",
                    remedy="It must be positive and finite.",
                )
        if not all((self.part, *self.parts)):
            raise ScenarioError(
                "poil.part, or a key of poil.parts, is empty.", remedy="Give each part a name."
            )
        if not math.isfinite(self.table_height):
            raise ScenarioError(
                f"poil.table_height is {self.table_height}.", remedy="Write a height in metres."
            )
        roles = {"object": self.object, "fixture": self.fixture, "robot": self.robot}
        for role, name in roles.items():
            twins = [other for other in roles if other != role and roles[other] == name]
            if twins:
                raise ScenarioError(
                    f"poil.{role} and poil.{twins[0]} are both '{name}'.",
                    remedy="Name a model of its own for each.",
                )
        if not 0 <= self.latency < math.inf:
            raise ScenarioError(
                f"poil.latency is {self.latency} s.", remedy="It must be finite and not negative."
            )

"""The `poil` section of a scenario: the task and POIL's settings."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from operator import attrgetter

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.diagrams.scenario.demonstration_config import DemonstrationMotionConfig
from poil_drake.diagrams.scenario.hardware_config import HardwareConfig
from poil_drake.diagrams.scenario.value_ranges import require_not_negative, require_positive
from poil_drake.errors import ScenarioError
from poil_drake.grasping.candidates.grasp_candidate import GraspSamplingConfig
from poil_drake.perception.depth_noise import StereoDepthNoiseConfig
from poil_drake.perception.detectors.by_name.config import NamedDetectorConfig
from poil_drake.perception.faults.injector import Fault
from poil_drake.perception.fusion import FusionConfig
from poil_drake.perception.trackers.registry import TrackerConfigs
from poil_drake.robots.collision import CollisionConfig
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.disturbance_injector import Pulse
from poil_drake.systems.safety.faults import SafetyConfig


@dataclass(frozen=True, kw_only=True)
class Rates:
    """The `poil.rates` section: periods [s].

    A scenario file may give them as fractions, e.g. `tracker: 1/8`. The defaults are exact in
    binary, so that simultaneous events stay simultaneous.

    Attributes:
        plant: Time step of the simulated plant. The default is short enough for a grasped cup.
        control: Period of the propagator, the vector field, the differential inverse kinematics
            and the sequencer. The robot's driver needs 10 ms or less.
        tracker: Period of image captures. The default is about the time that a tracker needs.
        logger: Period of the run log and of Meshcat. The default gives a smooth animation.
    """

    plant: float = 1 / 512
    control: float = CONTROL_PERIOD
    tracker: float = 1 / 8
    logger: float = 1 / 32

    def __post_init__(self) -> None:
        for name in ("plant", "control", "tracker", "logger"):
            require_positive(f"poil.rates.{name}", getattr(self, name))
        for slow, fast in (("control", "plant"), ("tracker", "control"), ("logger", "control")):
            a, b = getattr(self, slow), getattr(self, fast)
            if Fraction(a) % Fraction(b) != 0:
                raise ScenarioError(
                    f"poil.rates.{slow} is {a} s, which is not an exact multiple of "
                    f"poil.rates.{fast}, {b} s.",
                    remedy="Use fractions whose denominators are powers of two, e.g. 1/256.",
                )

    def next_report(self, time: float) -> float:
        """Returns the time of the first log sample or image capture after `time` [s].

        The result is an exact multiple of `logger` or `tracker`, like the times of Drake's events.
        """
        return min(_next_multiple(period, time) for period in (self.logger, self.tracker))


def _next_multiple(period: float, time: float) -> float:
    count = round(time / period)
    return count * period if count * period > time else (count + 1) * period


@dataclass(frozen=True, kw_only=True)
class Randomization:
    """The `poil.randomization` section: ranges from which each trial draws; empty ones are ignored.

    Attributes:
        models: Model files, one of which is drawn as the object; paths are as in directives.
        x: Lowest and highest position of the object along the world's x axis [m].
        y: Lowest and highest position of the object along the world's y axis [m].
        yaw: Lowest and highest angle of the object about the world's z axis [deg].
    """

    models: tuple[str, ...] = ()
    x: tuple[float, ...] = ()
    y: tuple[float, ...] = ()
    yaw: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw"):
            value = getattr(self, name)
            if value and not (len(value) == 2 and value[0] <= value[1]):
                raise ScenarioError(
                    f"poil.randomization.{name} is {list(value)}, which is not a range.",
                    remedy="Use [lowest, highest], or [] for no randomization.",
                )


@dataclass(frozen=True, kw_only=True)
class PartRegion:
    """The part of an object that lies in a box; the box is in the frame of each of its links.

    A side that is not given is at infinity. With one side, the part is what lies beyond a plane.

    Attributes:
        lower: Lowest coordinates along the box's axes [m].
        upper: Highest coordinates along the box's axes [m].
        rpy: Roll, pitch and yaw of the box's axes; the box turns about the link's origin [deg].
    """

    lower: tuple[float, float, float] = (-math.inf,) * 3
    upper: tuple[float, float, float] = (math.inf,) * 3
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ScenarioError(
                f"A part's region reaches from {list(self.lower)} to "
                f"{list(self.upper)}, so it is empty.",
                remedy="Each value of lower must be less than that of upper.",
            )

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Returns whether each of the points (n, 3) [m] in the link's frame is in the box, (n,)."""
        own = Rotation.from_euler("xyz", self.rpy, degrees=True).inv().apply(points)
        return np.all((own >= self.lower) & (own <= self.upper), axis=1)


_POSITIVE = (
    "eta",
    "max_angular_speed",
    "max_linear_speed",
    "grasp.seed_points",
    "fusion.mask.relative_jump",
)
_NOT_NEGATIVE = (
    "latency",
    "grasp.part_clearance",
    "clearance.robot_margin",
    "clearance.object_margin",
    "fusion.voxel_size",
    "fusion.outlier_neighbours",
    "fusion.mask.erosion",
    "fusion.mask.edge_margin",
    "fusion.mask.min_depth",
)


@dataclass(frozen=True, kw_only=True)
class PoilConfig:
    """The `poil` section: the task and POIL's settings.

    Attributes:
        object: Model instance of the manipulated object; or <model>::<body> if the object is one
            body, with what it carries, of a larger model.
        part: Name of the object's functional part.
        parts: Part name -> a link of the object, a regular expression for names of its
            geometries, or a region (`!PartRegion`) of its visual meshes. A part that is not listed
            is the link of the same name.
        fixture: Model instance, or body of a model, with which the object interacts.
        robot: Model instance of the robot.
        packages: `package.xml` files, or folders with such files, of the packages that `package://`
            paths name in directives and models. Paths are relative to the scenario file.
        collision: What becomes of concave collision meshes, of which Drake would use the filled
            convex hull: "decompose" replaces them by convex pieces, "hull" keeps the hull, and None
            refuses them.
        table_height: Height of the plane on which objects stand [m, world].
        calibration: A file with the cameras' poses, which replace those in `cameras`; written by
            `poil calibrate cameras`. Empty for none, and in a scenario that has been loaded.
        demonstration: A recorded demonstration (.mcap); None simulates the built-in one.
        demonstration_object_label: The object's name in the recording; None means `object`.
        demonstration_object: Model file of the object in the built-in demonstration.
        demonstration_parts: Like `parts`, for `demonstration_object`. A part that is not listed is
            the same as in `parts`.
        demonstration_motion: The object's motion in the built-in demonstration.
        detector: How the object and its part are found: "demonstration" needs nothing but what the
            demonstration shows; "by_name" asks a learned model for the words that name them;
            "label_image" reads a simulator's label images.
        detector_config: Models and words of the detector "by_name".
        labels: Files of `poil label` for the detector "by_hand": of the demonstration and of the
            scene.
        tracker: Name of the point tracker: rigid_flow, lucas_kanade, mvtracker, cotracker3, or
            ground_truth.
        tracker_config: Tracker's name -> its parameters.
        fusion: How the cameras' images become the part's cloud. The clouds of the whole object and
            of the obstacles have voxels twice as large.
        grasp: How grasps are sampled.
        clearance: Clearances that robot and object keep from the scene in a plan.
        num_points: Number of points on the functional part, N_k in the paper.
        num_support_points: Number of points, spread over the object, with which the tracker
            measures how much of the object is visible: at least 4 (40 in the paper).
        eta: Gain of the attraction to the reference trajectory, η in the paper [1/s].
        max_angular_speed: Limit on the gripper's angular speed [rad/s]. The wrist can follow the
            default.
        max_linear_speed: Limit on the gripper's linear speed [m/s]. The default is a human pace.
        latency: Time from the capture of images to the release of the points tracked in them [s],
            including the cameras' output_delay.
        depth_noise: Errors of the simulated depth cameras.
        faults: Faults of the simulated cameras and of what they see, in the run but not in the
            demonstration; not used on hardware.
        disturbances: Pushes on bodies of the simulated plant; not used on hardware.
        rates: Periods of the plant, the control, the tracker and the logger.
        randomization: Ranges from which randomized trials draw.
        safety: When the supervisor stops the arm, and how it limits motion.
        hardware: Connections to the real robot and cameras, and the speed on hardware.
    """

    object: str = "mug"
    part: str = "handle"
    parts: Mapping[str, str | PartRegion] = field(default_factory=dict)
    fixture: str = "rack"
    robot: str = "panda"
    packages: tuple[str, ...] = ()
    collision: str | None = None
    table_height: float = 0.0
    calibration: str = ""
    demonstration: str | None = None
    demonstration_object_label: str | None = None
    demonstration_object: str = "package://poil_drake/mugs/mug_demo/mug_demo.sdf"
    demonstration_parts: Mapping[str, str | PartRegion] = field(default_factory=dict)
    demonstration_motion: DemonstrationMotionConfig = field(
        default_factory=DemonstrationMotionConfig
    )
    detector: str = "demonstration"
    detector_config: NamedDetectorConfig = field(default_factory=NamedDetectorConfig)
    labels: tuple[str, ...] = ()
    tracker: str = "rigid_flow"
    tracker_config: TrackerConfigs = field(default_factory=TrackerConfigs)
    fusion: FusionConfig = field(default_factory=FusionConfig)
    grasp: GraspSamplingConfig = field(default_factory=GraspSamplingConfig)
    clearance: CollisionConfig = field(default_factory=CollisionConfig)
    num_points: int = 10
    num_support_points: int = 40
    eta: float = 3.0
    max_angular_speed: float = 1.0
    max_linear_speed: float = 0.25
    latency: float = 1 / 16
    depth_noise: StereoDepthNoiseConfig = field(default_factory=StereoDepthNoiseConfig)
    faults: tuple[Fault, ...] = ()
    disturbances: tuple[Pulse, ...] = ()
    rates: Rates = field(default_factory=Rates)
    randomization: Randomization = field(default_factory=Randomization)
    hardware: HardwareConfig = field(default_factory=HardwareConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)

    def __post_init__(self) -> None:
        for name, lowest in (("num_points", 3), ("num_support_points", 4)):
            if getattr(self, name) < lowest:
                raise ScenarioError(
                    f"poil.{name} is {getattr(self, name)}, which is too few.",
                    remedy=f"It must be at least {lowest}.",
                )
        if self.collision not in (None, "decompose", "hull"):
            raise ScenarioError(
                f"poil.collision is '{self.collision}'.", remedy="Choose 'decompose' or 'hull'."
            )
        for name in _POSITIVE:
            require_positive(f"poil.{name}", attrgetter(name)(self))
        for name in _NOT_NEGATIVE:
            require_not_negative(f"poil.{name}", attrgetter(name)(self))
        angle = self.grasp.approach_angle
        require_positive("poil.grasp.approach_angle", angle, largest=math.pi / 2)
        mask = self.fusion.mask
        if not mask.min_depth < mask.max_depth:
            raise ScenarioError(
                f"poil.fusion.mask.max_depth is {mask.max_depth} m, not more than min_depth, "
                f"{mask.min_depth} m.",
                remedy="Raise it beyond the largest distance of the scene from a camera.",
            )
        if not all((self.part, *self.parts)):
            place = "A key of poil.parts" if self.part else "poil.part"
            raise ScenarioError(f"{place} is empty.", remedy="Name the part.")
        if unknown := self.demonstration_parts.keys() - {self.part, *self.parts}:
            raise ScenarioError(
                f"poil.demonstration_parts names the part '{min(unknown)}', which is neither "
                "poil.part nor in poil.parts.",
                remedy=f"Choose one of: {', '.join({self.part: None, **self.parts})}.",
            )

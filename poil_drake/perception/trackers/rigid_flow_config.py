"""Parameters of the rigid-flow tracker."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.perception.trackers.alignment_config import (
    ContourConfig,
    DepthConfig,
    ModelConfig,
    TextureConfig,
    WindowConfig,
)


@dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """How far from its prediction an object is expected to be.

    Deviations of speed; over a step of 1/8 s, 20 deg/s and 0.04 m/s are 2.5 deg and 5 mm.

    Attributes:
        free_angular: Without a motion prior, whose place constant velocity takes [rad/s].
        free_linear: Likewise [m/s].
        prior_angular: With a motion prior [rad/s].
        prior_linear: Likewise [m/s].
        start_angular: Deviation of the first pose from itself [rad]: what the model's noise makes.
        start_linear: Likewise [m].
        robustness: Degrees of freedom of the prediction's Student-t error: the fewer, the more
            readily the data overrule it (slip, pushes).
        velocity_gain: Share of the newest velocity in the velocity that is carried on.
        velocity_damping: Part of the velocity that is carried on into the next step.
        max_extrapolation: Longest time over which a velocity is carried on [s].
        settled_angular: Steps of the alignment below this end it [rad], if also below
        settled_linear: this [m].
    """

    free_angular: float = float(np.radians(20.0))
    free_linear: float = 0.04
    prior_angular: float = float(np.radians(8.0))
    prior_linear: float = 0.015
    start_angular: float = 1e-3
    start_linear: float = 1e-4
    robustness: float = 4.0
    velocity_gain: float = 0.7
    velocity_damping: float = 0.95
    max_extrapolation: float = 0.5
    settled_angular: float = float(np.radians(0.05))
    settled_linear: float = 1e-4


@dataclass(frozen=True, kw_only=True)
class GrowthConfig:
    """How surfaces that come into view join the model.

    Attributes:
        enabled: Whether the model grows while there is no motion prior.
        with_motion_prior: Whether it also grows with one. A hand that holds the object moves as
            the object does, which is the one thing that growth cannot tell from the object.
        rotation: The object must have turned by this much in a view since it last grew [rad].
        travel: Or it must have moved by this much [m]: other things may have hidden it.
        reach: How far from the known surface new surface may lie in the image [px].
        distance: How far from the known surface new points may lie in space [m].
        known_error: Measured depth within this of the model is known already [m].
        clearance: A new point must have been hidden by this much in the first frame [m].
        min_cosine: Least cosine between the new surface and the line of sight.
        trust: Weight of what was learnt, against 1 for what was seen at first. All points that
            are learnt at once share the error of the pose at that time, however many they are.
        max_points: How many surface points the model may hold.
        max_patches: How many patches are learnt at once from a view.
    """

    enabled: bool = True
    with_motion_prior: bool = False
    rotation: float = float(np.radians(10.0))
    travel: float = 0.03
    reach: int = 12
    distance: float = 0.02
    known_error: float = 0.006
    clearance: float = 0.008
    min_cosine: float = 0.4
    trust: float = 0.2
    max_points: int = 7000
    max_patches: int = 12


@dataclass(frozen=True, kw_only=True)
class QualityConfig:
    """When a pose is believed, and how much.

    Attributes:
        inlier_error: A model point whose depth is measured within this is seen [m].
        hidden_error: A model point this much behind measured depth is hidden by something [m].
        min_cosine: Least cosine between normal and line of sight of the model points that count.
        min_support: With fewer support points seen, in all views together, a pose has no support.
        edge_error: An outline pixel whose edge is found within this is confirmed [px].
        retry_agreement: Below this agreement other poses are tried.
        lost_agreement: Below this agreement the object is lost.
        found_agreement: A lost object is found again above this agreement.
        learn_agreement: The model grows only above this agreement.
        learn_deviation: The model grows only while part points are this sure [m].
        point_deviation: A part point with this standard deviation has confidence 0.6 [m].
        lost_deviation: With part points less sure than this the object is lost [m].
        optimism: How many times too much the data seem to tell of the pose, because errors of the
            model stay the same from frame to frame. Measured: errors over deviations.
        visible_error: A part point is visible where depth is measured within this of it [m].
        hidden_confidence: Factor on the confidence of a part point that no view shows.
    """

    inlier_error: float = 0.006
    hidden_error: float = 0.03
    min_cosine: float = 0.4
    min_support: int = 4
    edge_error: float = 2.5
    retry_agreement: float = 0.8
    lost_agreement: float = 0.6
    found_agreement: float = 0.8
    learn_agreement: float = 0.85
    learn_deviation: float = 0.006
    point_deviation: float = 0.01
    lost_deviation: float = 0.025
    optimism: float = 5.0
    visible_error: float = 0.01
    hidden_confidence: float = 0.6


@dataclass(frozen=True, kw_only=True)
class RetryConfig:
    """Which poses are tried when the predicted one leads nowhere.

    Attributes:
        rotations: Turned about each axis, to both sides, by these [rad].
        translations: Moved along each axis, to both sides, by these [m].
        stride: Poses are first compared by every so-many-th point.
        aligned: How many of the tried poses, the most promising ones, are aligned; each costs as
            much as a step.
        angular: Standard deviation of the aligned pose around the tried one [rad].
        linear: Likewise [m].
    """

    rotations: tuple[float, ...] = (float(np.radians(8.0)), float(np.radians(20.0)))
    translations: tuple[float, ...] = (0.012, 0.03)
    stride: int = 4
    aligned: int = 2
    angular: float = float(np.radians(10.0))
    linear: float = 0.01


@dataclass(frozen=True, kw_only=True)
class RigidFlowConfig:
    """Parameters of the rigid-flow tracker, by concern."""

    window: WindowConfig = field(default_factory=WindowConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)
    contour: ContourConfig = field(default_factory=ContourConfig)
    texture: TextureConfig = field(default_factory=TextureConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    growth: GrowthConfig = field(default_factory=GrowthConfig)
    quality: QualityConfig = field(default_factory=QualityConfig)
    retry: RetryConfig = field(default_factory=RetryConfig)

    def __post_init__(self) -> None:
        lengths = {
            "depth.gates": len(self.depth.gates),
            "contour.gates": len(self.contour.gates),
            "texture.min_correlations": len(self.texture.min_correlations),
        }
        if len(set(lengths.values())) != 1:
            raise InvalidValueError(
                f"RigidFlowConfig has schedules of different lengths: {lengths}.",
                remedy="Give each one value for each iteration.",
            )

"""Parameters of the rigid-flow tracker."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.perception.trackers.rigid_flow.alignment.config import (
    AppearanceConfig,
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
        disobedience: An object that in the last step was this many deviations off its motion prior
            is not expected to follow it in the next.
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
    disobedience: float = 3.0
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
        enough_points: With fewer than this share of the model points to look at, in all views
            together, a pose is borne out the less.
        hidden_share: With no more than this share of the points seen otherwise, the object is taken
            to be hidden, not gone.
        retry_vacant: Above this share of what is the object's by its colour, but lies where the
            object is known not to be, other poses are tried, unless the object has just moved as
            was expected.
        max_vacant: Of what is the object's by its colour, no more than this share may lie where the
            object is known not to be.
        found_deviation: A lost object is found only with part points this sure [m].
        found_near_angular: A lost object that is found this near to where it was expected [rad],
        found_near_linear: and this near [m], is found at once. Elsewhere the next frame has to
            confirm it.
        hidden_error: A model point this much behind measured depth is hidden by something [m].
        self_hidden: A model point this much behind the model's own nearest surface is hidden by
            the object itself [m].
        min_cosine: Least cosine between normal and line of sight of the model points that count.
        min_support: With fewer support points seen, in all views together, a pose has no support.
        edge_error: An outline pixel whose edge is found within this is confirmed [px].
        retry_agreement: Below this agreement other poses are tried.
        lost_agreement: Below this agreement the object is lost.
        guess_agreement: A pose above this agreement is where a lost object is searched next.
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
    enough_points: float = 0.1
    hidden_share: float = 0.1
    retry_vacant: float = 0.02
    max_vacant: float = 0.04
    found_deviation: float = 0.01
    found_near_angular: float = float(np.radians(5.0))
    found_near_linear: float = 0.01
    hidden_error: float = 0.03
    self_hidden: float = 0.008
    min_cosine: float = 0.4
    min_support: int = 4
    edge_error: float = 2.5
    retry_agreement: float = 0.85
    lost_agreement: float = 0.7
    guess_agreement: float = 0.5
    found_agreement: float = 0.85
    learn_agreement: float = 0.85
    learn_deviation: float = 0.006
    point_deviation: float = 0.01
    lost_deviation: float = 0.025
    optimism: float = 5.0
    visible_error: float = 0.01
    hidden_confidence: float = 0.6


@dataclass(frozen=True, kw_only=True)
class SearchConfig:
    """How the object is searched for where it was not found as predicted.

    Attributes:
        near_angular: Standard deviation of the poses that are searched first [rad].
        near_linear: Likewise [m].
        growth_angular: By how much more they differ for every second that the object is lost
            [rad/s].
        growth_linear: Likewise [m/s].
        far_angular: But no more than this [rad],
        far_linear: and this [m].
        points: How many model points are compared with depth.
        elsewhere: Weight of the points that are the object's by their colour, against the object's
            own surface.
        drawn: How many poses are drawn around what is known.
        kept: How many of them, the best, are varied in each further round.
        varied: Into how many poses each of these.
        angular: Standard deviation of the first variation [rad]; each further one is half as far.
        linear: Likewise [m].
        gates: Residuals above this do not count [m]; one for each round, coarse to fine.
        aligned: How many of the poses found are aligned; each costs as much as a step.
        aligned_angular: Standard deviation of an aligned pose around the one found [rad].
        aligned_linear: Likewise [m].
        distinct_angular: Poses that differ by less than this [rad] and by less than
        distinct_linear: this [m] are the same.
    """

    near_angular: float = float(np.radians(20.0))
    near_linear: float = 0.025
    growth_angular: float = float(np.radians(20.0))
    growth_linear: float = 0.03
    far_angular: float = float(np.radians(60.0))
    far_linear: float = 0.1
    points: int = 128
    elsewhere: float = 1.5
    drawn: int = 640
    kept: int = 12
    varied: int = 20
    angular: float = float(np.radians(10.0))
    linear: float = 0.01
    gates: tuple[float, ...] = (0.02, 0.012, 0.008)
    aligned: int = 2
    aligned_angular: float = float(np.radians(10.0))
    aligned_linear: float = 0.01
    distinct_angular: float = float(np.radians(10.0))
    distinct_linear: float = 0.01


@dataclass(frozen=True, kw_only=True)
class RigidFlowConfig:
    """Parameters of the rigid-flow tracker, by concern."""

    window: WindowConfig = field(default_factory=WindowConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)
    contour: ContourConfig = field(default_factory=ContourConfig)
    texture: TextureConfig = field(default_factory=TextureConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    growth: GrowthConfig = field(default_factory=GrowthConfig)
    quality: QualityConfig = field(default_factory=QualityConfig)
    search: SearchConfig = field(default_factory=SearchConfig)

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

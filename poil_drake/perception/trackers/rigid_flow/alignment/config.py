"""Parameters of aligning the rigid-flow tracker's model with views."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class WindowConfig:
    """How the part of an image around the object is prepared.

    Attributes:
        margin: Border around the object's predicted outline [px]. The object may move as far
            between two frames beyond its prediction, and contours are searched there.
        edge_jump: Neighbouring pixels whose depth differs by more than this part of the depth are
            a depth edge, where depth is mixed. 0.015 is 1 cm at 0.65 m.
        blur: Standard deviation of the blur before image gradients are taken [px].
    """

    margin: int = 24
    edge_jump: float = 0.015
    blur: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ModelConfig:
    """How the object is modelled from what is seen of it.

    Attributes:
        erosion: Border taken off the object's masks [px]; detectors spill over by about one.
        voxel_size: Spacing of the model's surface points [m]; two pixels at 0.65 m.
        normal_smoothing: Half width of the box over which normals are averaged [px].
        aligned_points: How many surface points enter the alignment; the cost is in proportion.
        support_points: How many points, spread over the object, tell how much of it is seen
            (POIL uses 40).
        min_points: With fewer surface points the tracker refuses to start.
    """

    erosion: int = 1
    voxel_size: float = 0.003
    normal_smoothing: int = 2
    aligned_points: int = 1200
    support_points: int = 40
    min_points: int = 100


@dataclass(frozen=True, kw_only=True)
class AppearanceConfig:
    """How the object is told by its colours, and by where it is not.

    Attributes:
        surroundings: How far around the object empty space is known [m].
        spacing: Of the grid of empty space [m].
        clearance: A place was seen to be empty with measured depth this far behind it [m].
        tolerance: The object may be this far inside of empty space: errors of the pose [m].
        softness: From there on it counts more and more against a pose, over this distance [m].
        margin: Points up to this far beyond the object's radius tell about its pose [m].
        looked_at: How many pixels of a view are looked at, about.
        observed: How many of those that show the object are used, at most.
        min_sureness: Pixels whose colour shows the object less surely do not count.
        min_neighbours: Nor do pixels with fewer of their 8 neighbours within `clearance` of their
            depth: along edges depth flies between two surfaces.
        few_observed: With no more of such pixels than this, they count half as much.
        deviation: Standard deviation of how far inside of empty space the object is [m].
        correlation: How many of the observed points count as one.
        gate: Points farther inside of empty space are another thing's [m].
        share_deviation: Colours whose shares of red or blue differ by this are not the same.
        brightness_deviation: Likewise with their brightness, which changes with the light.
    """

    surroundings: float = 0.04
    spacing: float = 0.004
    clearance: float = 0.008
    tolerance: float = 0.002
    softness: float = 0.008
    margin: float = 0.02
    looked_at: int = 4096
    observed: int = 128
    min_sureness: float = 0.3
    min_neighbours: int = 3
    few_observed: float = 20.0
    deviation: float = 0.003
    correlation: float = 4.0
    gate: float = 0.03
    share_deviation: float = 0.06
    brightness_deviation: float = 0.6


@dataclass(frozen=True, kw_only=True)
class DepthConfig:
    """The point-to-plane term: model points against measured depth.

    Attributes:
        deviation: Standard deviation of a residual [m]: depth noise and the model's error.
        correlation: How many residuals count as one, because neighbours err together.
        min_cosine: Least cosine between a surface normal and the line of sight.
        gates: Residuals above this do not count [m]; one for each iteration, coarse to fine.
        normal_deviation: Standard deviation of the model's normals [rad], by which a surface seems
            to tell more of its pose than it does.
    """

    deviation: float = 0.001
    correlation: float = 20.0
    min_cosine: float = 0.25
    gates: tuple[float, ...] = (0.02, 0.015, 0.01, 0.008, 0.006, 0.006)
    normal_deviation: float = 0.06


@dataclass(frozen=True, kw_only=True)
class ContourConfig:
    """The contour term: the model's outline against edges of measured depth.

    Attributes:
        splat: Half width of the square that a model point covers [px]; closes the gaps between
            points that are `ModelConfig.voxel_size` apart.
        model_jump: Depth step that makes an outline of the model [m].
        image_jump: Depth step that ends the object in the image [m].
        search: How far to either side of the model's outline an edge is looked for [px].
        deviation: Standard deviation of an edge's place [px].
        correlation: How many edge pixels count as one.
        gates: Residuals above this do not count [px]; one for each iteration.
        search_iterations: Iterations in which edges are looked for anew; each costs a rendering.
        max_edges: How many outline pixels of a view are used.
        direction_deviation: Standard deviation of the outline's direction [rad].
    """

    splat: int = 2
    model_jump: float = 0.015
    image_jump: float = 0.012
    search: int = 8
    deviation: float = 1.0
    correlation: float = 6.0
    gates: tuple[float, ...] = (10.0, 8.0, 6.0, 5.0, 4.0, 4.0)
    search_iterations: tuple[int, ...] = (0, 3)
    max_edges: int = 160
    direction_deviation: float = 0.2


@dataclass(frozen=True, kw_only=True)
class TextureConfig:
    """The texture term: small patches of the surface against the image.

    Attributes:
        half_width: Patches have 2 half_width + 1 samples a side.
        spacing: Distance of samples in the image that the patch was taken from [px].
        min_contrast: Least standard deviation of grey over a patch, after a plane of grey is
            taken off [grey levels of 255]. Shading is such a plane; texture is not.
        max_bulge: Where depth leaves a patch's plane by more, the patch is no good [m]: shading
            changes over rims and handles as the object turns.
        max_patches: How many patches are taken from one view of the first frame.
        max_total: How many patches the model may hold.
        max_shown: How many patches of a view are used, the most trusted first.
        min_cosine: Least cosine between a patch's normal and the line of sight.
        min_view_cosine: Least cosine between lines of sight now and when the patch was taken.
        max_depth_error: A patch is hidden where depth differs from it by more [m].
        search: In the first iterations patches are searched this many samples to each side.
        search_iterations: How many iterations go by that search, before grey levels are compared.
        search_correlation: Least correlation of a patch that counts as found.
        search_deviation: Standard deviation of the place where a patch is found [px].
        search_gate: Found places farther from the prediction do not count [px].
        min_correlations: Patches that correlate less with the image are left out; one for each
            iteration.
        deviation: Standard deviation of a residual [grey levels].
        correlation: How many residuals count as one.
    """

    half_width: int = 2
    spacing: float = 1.5
    min_contrast: float = 7.0
    max_bulge: float = 0.003
    max_patches: int = 40
    max_total: int = 400
    max_shown: int = 60
    min_cosine: float = 0.35
    min_view_cosine: float = 0.5
    max_depth_error: float = 0.01
    search: int = 3
    search_iterations: int = 2
    search_correlation: float = 0.7
    search_deviation: float = 1.0
    search_gate: float = 6.0
    min_correlations: tuple[float, ...] = (0.3, 0.3, 0.5, 0.6, 0.6, 0.6)
    deviation: float = 3.0
    correlation: float = 10.0

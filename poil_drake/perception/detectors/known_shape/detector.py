"""The detector that recognizes a known shape."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.errors import DetectionError
from poil_drake.geometry.depth_image import DepthMaskConfig
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.perception.detectors.known_shape.contact_region import grown_along_thin_piece
from poil_drake.perception.detectors.known_shape.moved_object import Masks, world_points
from poil_drake.perception.detectors.known_shape.object_clusters import object_clusters
from poil_drake.perception.detectors.known_shape.shape_fit import KnownShape, Placements
from poil_drake.perception.detectors.known_shape.shape_search import FoundShape, search_shape
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import MultiViewFrame

SHAPE_FUSION = FusionConfig(
    mask=DepthMaskConfig(erosion=0, edge_margin=0), voxel_size=0.003, outlier_neighbours=8
)
"""How clouds are made for a search: with all pixels, since thin parts consist of edges."""

_MAX_COST = 0.25  # of a shape that is found; most other objects cost more
_MARGIN = 0.02  # by which other objects, and other places of the part, must cost more
_MIN_SEEN = 0.3  # share of the part's points that must be seen
_MAX_THROUGH = 0.2  # largest share of the part's points that may be seen through
_OTHER_PART = 0.03  # distance at which a part is another one [m]
_OBJECT_REACH, _PART_REACH = 0.03, 0.015  # of the object and its part from the placed shape [m]
_PIXEL_REACH = 0.006  # of a pixel from the cloud [m]
_START_QUANTILE = 0.6  # a thin part grows from those of its points that are farthest from the rest
_GROWN_REACH, _TOLERANCE = 0.03, 0.003  # of a thin part that has grown [m]
_THIN_SHARE = 0.6  # a part is thin if growing it in the shape itself gives this share of it


class KnownShapeDetector:
    """Finds the object that has a known shape, or one similar to it; a `Detector`.

    The shape is searched in each cluster of points above the table. It may be stretched, and lie in
    any orientation. The part is where the shape's part comes to lie.
    """

    def __init__(
        self,
        shape: KnownShape,
        *,
        table_height: float,
        background: np.ndarray | None = None,
        is_same: bool = False,
    ):
        """Constructs the detector.

        Args:
            shape: The shape to find.
            table_height: Height of the plane on which objects stand [m, world].
            background: (B, 3) points that belong to no object, such as the fixture's [m, world].
            is_same: Whether to find the very object that the shape is of. It has not changed its
                size, and probably is where the shape is.
        """
        self._shape, self._table_height, self._is_same = shape, table_height, is_same
        self._background = np.zeros((0, 3)) if background is None else background
        own = shape.cloud.points
        grown = _transferred_part(own, shape.part, own, thin=True)
        self._thin = (grown & shape.part).sum() > _THIN_SHARE * (grown | shape.part).sum()

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the object and of its part in each view; see `Detector.detect`.

        Raises:
            DetectionError: if no cluster has the shape, if several have it, if the part may be in
                several places, or if no view shows it.
        """
        found = sorted(self._candidates(frame), key=lambda one: one.cost)
        if not found or found[0].cost > _MAX_COST:
            cost = f"; the best fit costs {found[0].cost:.2f}" if found else ""
            raise DetectionError(
                f"None of the {len(found)} objects on the table looks like the demonstrated "
                f"'{object_label}'{cost}, and {_MAX_COST:g} is the most for a likeness.",
                remedy="Put the object where the cameras see it, apart from others, or name it: "
                "poil.detector.",
            )
        what = f"the part '{part_label}' of '{object_label}'"
        likely = [one for one in found if one.cost <= found[0].cost + _MARGIN]
        doubts = [self._doubt(one, what) for one in likely]
        certain = [one for one, doubt in zip(likely, doubts, strict=True) if doubt is None]
        if not certain:
            raise DetectionError(
                str(doubts[0]),
                remedy="Turn the object so that the cameras see the part, or add a camera.",
            )
        if len(certain) > 1:
            raise DetectionError(
                f"Two objects look like the demonstrated '{object_label}': at "
                f"{_text(certain[0].center)} m and at {_text(certain[1].center)} m.",
                remedy="Leave one of them on the table.",
            )
        return self._masks(frame, certain[0])

    def _candidates(self, frame: MultiViewFrame) -> list["_Candidate"]:
        clusters = object_clusters(
            frame, table_height=self._table_height, background=self._background
        )
        found = []
        for masks in clusters:
            try:
                cloud = fuse_views(frame, masks, SHAPE_FUSION)
            except DetectionError:  # Only edges: noise.
                continue
            if len(cloud) < 50:
                continue
            shape = search_shape(
                self._shape,
                frame,
                cloud,
                table_height=self._table_height,
                rigid=self._is_same,
                expected=Placements.at_rest(self._shape) if self._is_same else None,
            )
            found.append(_Candidate(masks, cloud, shape))
        return found

    def _doubt(self, candidate: "_Candidate", what: str) -> str | None:
        """Returns why a candidate's part cannot be told; None if it can."""
        found = candidate.found
        centers = found.part_centers()
        elsewhere = np.linalg.norm(centers - centers[0], axis=1) > _OTHER_PART
        if np.any(found.costs[elsewhere] < candidate.cost + _MARGIN):
            return (
                f"{what[0].upper()}{what[1:]} may be at {_text(centers[0])} m or at "
                f"{_text(centers[elsewhere][0])} m; both fit what the views show."
            )
        seen, through = found.fit.support(self._placed(candidate)[self._shape.part])
        if seen < _MIN_SEEN or through > _MAX_THROUGH:
            return (
                f"The views show only {seen:.0%} of where {what} should be, at "
                f"{_text(centers[0])} m, and see through {through:.0%}."
            )
        return None

    def _placed(self, candidate: "_Candidate") -> np.ndarray:
        """Returns the shape's points (P, 3) where they fit best [m, world]."""
        best = candidate.found.placements.select(np.array([0]))
        return best.apply(self._shape, self._shape.cloud.points)[0]

    def _masks(self, frame: MultiViewFrame, best: "_Candidate") -> PartMasks:
        placed, shape = self._placed(best), self._shape
        cloud = best.cloud.points
        is_object = cKDTree(placed).query(cloud)[0] < _OBJECT_REACH
        is_part = is_object & _transferred_part(placed, shape.part, cloud, thin=self._thin)
        tree, objects, parts = cKDTree(cloud), list[np.ndarray](), list[np.ndarray]()
        for camera, image, mask in zip(frame.cameras, frame.images, best.masks, strict=True):
            distance, nearest = tree.query(world_points(camera, image.depth)[mask])
            near = distance < _PIXEL_REACH
            objects.append(_filled(mask, near & is_object[nearest]))
            parts.append(_filled(mask, near & is_part[nearest]))
        return PartMasks(tuple(objects), tuple(parts))


def _transferred_part(
    placed: np.ndarray, part: np.ndarray, cloud: np.ndarray, *, thin: bool
) -> np.ndarray:
    """Returns which points (Q,) bool of a cloud belong to the part of a shape that lies on it.

    Args:
        placed: (P, 3) the shape's points [m, world].
        part: (P,) bool, which of them belong to the part.
        cloud: (Q, 3) points of the object [m, world].
        thin: Whether the part is a thin piece, as a handle is. Then what is nearest to the shape's
            part only starts the region, because the object's body may be larger than the shape's.
    """
    to_part = cKDTree(placed[part]).query(cloud)[0]
    if part.all():
        return to_part < _PART_REACH
    to_rest = cKDTree(placed[~part]).query(cloud)[0]
    nearest = (to_part < _PART_REACH) & (to_part < to_rest)
    if not thin or not nearest.any():
        return nearest
    start = nearest & (to_rest >= np.quantile(to_rest[nearest], _START_QUANTILE))
    grown = grown_along_thin_piece(cloud, start)
    return grown & (to_part < _GROWN_REACH) & (to_part < to_rest + _TOLERANCE)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A cluster of points, and how the shape fits it."""

    masks: Masks
    cloud: PointCloud
    found: FoundShape

    @property
    def cost(self) -> float:
        return float(self.found.costs[0])

    @property
    def center(self) -> np.ndarray:
        return self.cloud.points.mean(axis=0)


def _filled(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Returns a mask with values (n,) bool at the n True pixels of another."""
    result = np.zeros(mask.shape, dtype=bool)
    result[mask] = values
    return result


def _text(point: np.ndarray) -> str:
    return f"({', '.join(f'{x:.2f}' for x in point)})"

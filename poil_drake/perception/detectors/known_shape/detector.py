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

_MAX_COST = 0.25  # of an object of the shape's kind; most others cost more
_PART_WEIGHT = 0.1  # of the shares of the part that are not seen, and seen through, in the cost
_MARGIN = 0.02  # by which other objects, and other places of the part, must cost more
_MIN_SEEN, _MAX_THROUGH = 0.5, 0.2  # shares of the part's points that are seen, and seen through
_MAX_UNLIKE, _CLEAR, _CLEARLY_SEEN = 0.3, 0.05, 0.6
"""Cost, margin and share for an object with other proportions, whose part must be the clearer."""

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
        what = f"the part '{part_label}' of '{object_label}'"
        found = sorted(self._candidates(frame), key=lambda one: one.cost)
        if not found or found[0].fit_cost > _MAX_UNLIKE:
            cost = f"; the best fit costs {found[0].fit_cost:.2f}" if found else ""
            raise DetectionError(
                f"None of the {len(found)} objects on the table looks like '{object_label}'{cost}, "
                f"and {_MAX_UNLIKE:g} is the most for a likeness.",
                remedy="Put the object where the cameras see it, apart from others, or name it: "
                "poil.detector.",
            )
        doubt = found[0].doubt(what)
        if doubt is not None:
            raise DetectionError(
                doubt, remedy="Turn the object so that the cameras see the part, or add a camera."
            )
        if len(found) > 1 and found[1].cost < found[0].cost + _MARGIN:
            raise DetectionError(
                f"Two objects look like '{object_label}': at {_text(found[0].center)} m and at "
                f"{_text(found[1].center)} m.",
                remedy="Leave one of them on the table.",
            )
        return self._masks(frame, found[0])

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
            found.append(_Candidate.of(masks, cloud, shape))
        return found

    def _masks(self, frame: MultiViewFrame, best: "_Candidate") -> PartMasks:
        placed, shape = best.placed[0], self._shape
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
    """A cluster of points, and the ways in which the shape fits it, the likeliest first.

    Attributes:
        masks: The cluster's pixels in each view.
        cloud: The cluster's points [m, world].
        placed: (K, P, 3) the shape's points [m, world].
        fit_costs: (K,) costs of the fits.
        seen: (K,) shares of the part's points that are seen.
        through: (K,) shares of the part's points that are seen through.
        part_centers: (K, 3) where the part is [m, world].
    """

    masks: Masks
    cloud: PointCloud
    placed: np.ndarray
    fit_costs: np.ndarray
    seen: np.ndarray
    through: np.ndarray
    part_centers: np.ndarray

    @classmethod
    def of(cls, masks: Masks, cloud: PointCloud, found: FoundShape) -> "_Candidate":
        shape = found.fit.shape
        placed = found.placements.apply(shape, shape.cloud.points)
        support = [found.fit.support(points[shape.part]) for points in placed]
        seen, through = np.array(support).T
        order = np.argsort(found.costs + _PART_WEIGHT * (1.0 - seen + through), kind="stable")
        return cls(
            masks,
            cloud,
            placed[order],
            found.costs[order],
            seen[order],
            through[order],
            found.part_centers()[order],
        )

    @property
    def costs(self) -> np.ndarray:
        """The fits' costs (K,), including that of a part that is not seen or is seen through."""
        return self.fit_costs + _PART_WEIGHT * (1.0 - self.seen + self.through)

    @property
    def cost(self) -> float:
        return float(self.costs[0])

    @property
    def fit_cost(self) -> float:
        return float(self.fit_costs[0])

    @property
    def center(self) -> np.ndarray:
        return self.cloud.points.mean(axis=0)

    def doubt(self, what: str) -> str | None:
        """Returns why it is doubtful where the part is; None if it is not."""
        unlike = self.fit_cost > _MAX_COST
        margin, least_seen = (_CLEAR, _CLEARLY_SEEN) if unlike else (_MARGIN, _MIN_SEEN)
        center, seen, through = self.part_centers[0], self.seen[0], self.through[0]
        if seen < least_seen or through > _MAX_THROUGH:
            return (
                f"The views show only {seen:.0%} of where {what} should be, at {_text(center)} m, "
                f"and see through {through:.0%}."
            )
        rivals = self.part_centers[self.costs < self.cost + margin]
        apart = np.linalg.norm(rivals - center, axis=1) > _OTHER_PART
        if np.any(apart):
            return (
                f"{what[0].upper()}{what[1:]} may be at {_text(center)} m or at "
                f"{_text(rivals[apart][0])} m; both fit what the views show."
            )
        return None


def _filled(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Returns a mask with values (n,) bool at the n True pixels of another."""
    result = np.zeros(mask.shape, dtype=bool)
    result[mask] = values
    return result


def _text(point: np.ndarray) -> str:
    return f"({', '.join(f'{x:.2f}' for x in point)})"

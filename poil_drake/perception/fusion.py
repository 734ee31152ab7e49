"""Fusion of several views of an object into one point cloud."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from poil_drake.errors import DetectionError
from poil_drake.geometry.depth_image import DepthMaskConfig, clean_mask, depth_normals, unproject
from poil_drake.geometry.pca_normals import pca_normals
from poil_drake.geometry.point_cloud import PointCloud, statistical_inliers, voxel_downsample
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

_OUTLIER_DEVIATIONS = 2.5  # standard deviations above the mean distance to neighbours
_NORMAL_STEP = 2  # distance to the pixels whose depths a normal is computed from [px]
_NORMAL_SMOOTHING = 2  # half width of the box that smooths normals [px]


@dataclass(frozen=True, kw_only=True)
class FusionConfig:
    """How to clean and merge the views.

    Attributes:
        mask: Which pixels to remove from each view's mask.
        voxel_size: Edge of the voxels in which points are averaged [m]; 0 keeps every point. A
            2 mm voxel holds about four pixels of each view at 0.65 m.
        outlier_neighbours: Number of neighbours used to detect an outlier; 0 keeps outliers.
    """

    mask: DepthMaskConfig = field(default_factory=DepthMaskConfig)
    voxel_size: float = 0.002
    outlier_neighbours: int = 16

    def coarser(self) -> "FusionConfig":
        """Returns this with voxels twice as large: a whole object has ten times a part's surface.

        They are still fine enough to detect contact between object and fixture.
        """
        return replace(self, voxel_size=2.0 * self.voxel_size)


def fuse_views(
    frame: MultiViewFrame, masks: Sequence[np.ndarray], config: FusionConfig | None = None
) -> PointCloud:
    """Returns one cloud [m, world] of the masked pixels of all views, with normals and colours.

    Normals are computed in each view and point towards the view's camera. Then the views are
    joined, points are averaged in voxels, and outliers are removed.

    Args:
        frame: The images.
        masks: One mask (H, W) bool for each of `frame.cameras`, in their order. The mask of a view
            that does not show the object is all False.
        config: Parameters; None for the defaults.

    Raises:
        DetectionError: if no masked pixel has usable depth.
    """
    config = config or FusionConfig()
    views = [
        _view_points(camera, image, mask, config)
        for camera, image, mask in zip(frame.cameras, frame.images, masks, strict=True)
    ]
    cloud = PointCloud(*(np.concatenate(parts) for parts in zip(*views, strict=True)))
    if len(cloud) == 0:
        marked = [int(np.count_nonzero(mask)) for mask in masks]
        raise DetectionError(
            f"No masked pixel has usable depth; the views' masks mark {marked} pixels.",
            remedy="Check that the cameras see the object and measure its depth, and that "
            "poil.fusion.mask leaves some of its pixels.",
        )
    if config.voxel_size > 0.0:
        cloud = voxel_downsample(cloud, config.voxel_size)
    if config.outlier_neighbours > 0:
        kept = statistical_inliers(
            cloud.points,
            neighbours=config.outlier_neighbours,
            deviations=_OUTLIER_DEVIATIONS,
        )
        cloud = cloud.select(kept)
    return cloud


def _view_points(
    camera: CameraModel, image: RgbdImage, mask: np.ndarray, config: FusionConfig
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns points [m, world], normals and colours of one view, each (P, 3)."""
    usable = clean_mask(np.asarray(mask, dtype=bool), image.depth, camera.K, config.mask)
    points, pixels = unproject(image.depth, camera.K, usable)
    colors = image.rgb[pixels[:, 1], pixels[:, 0]]
    if len(points) < 3:
        return points[:0], points[:0], colors[:0]
    # Unusable pixels are set to 0, so that no difference reaches across to the background.
    normals_image = depth_normals(
        np.where(usable, image.depth, np.float32(0.0)),
        camera.K,
        step=_NORMAL_STEP,
        smoothing=_NORMAL_SMOOTHING,
        relative_jump=config.mask.relative_jump,
    )
    normals = normals_image[pixels[:, 1], pixels[:, 0]].astype(float)
    # Along borders, and on parts a few pixels wide, central differences are not available.
    missing = np.flatnonzero(~np.isfinite(normals).all(axis=1))
    if missing.size:
        normals[missing] = pca_normals(points, missing)
    return transform_points(camera.X_WC, points), normals @ camera.X_WC[:3, :3].T, colors

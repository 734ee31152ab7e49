"""One point cloud of what several cameras see of an object."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import DetectionError, InvalidValueError
from poil_drake.geometry.depth_masks import DepthMaskConfig, clean_mask
from poil_drake.geometry.pca_normals import pca_normals
from poil_drake.geometry.point_cloud import (
    PointCloud,
    concatenate_clouds,
    statistical_inliers,
    voxel_downsample,
)
from poil_drake.geometry.unprojection import depth_normals, unproject
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage


@dataclass(frozen=True, kw_only=True)
class FusionConfig:
    """How views are cleaned and merged.

    Attributes:
        mask: What of each view's mask to trust.
        voxel_size: Edge of the voxels that are averaged [m]; 0 keeps every point. 2 mm holds
            some four pixels of each view at 0.65 m.
        outlier_neighbours: How many neighbours tell an outlier; 0 keeps outliers.
        outlier_deviations: How many standard deviations farther from its neighbours than the mean
            a point may be.
        normal_step: Distance of the pixels that normals are computed from [px].
        normal_smoothing: Half width of the box that smooths normals [px].
        normal_neighbours: Where the pixels beside one are missing, how many nearest points its
            normal is computed from.
    """

    mask: DepthMaskConfig = field(default_factory=DepthMaskConfig)
    voxel_size: float = 0.002
    outlier_neighbours: int = 16
    outlier_deviations: float = 2.5
    normal_step: int = 2
    normal_smoothing: int = 2
    normal_neighbours: int = 16


def fuse_views(
    frame: MultiViewFrame, masks: Sequence[np.ndarray], config: FusionConfig | None = None
) -> PointCloud:
    """Returns the cloud (world) of the masked pixels of all views, with normals and colours.

    Normals are computed in each view, where the side that the camera is on is known, before views
    are joined. Voxels then average over the views, and outliers are removed.

    Args:
        frame: The images.
        masks: One (H, W) bool for each camera, in the frame's order. Those of cameras that do not
            see the object are all false.
        config: Parameters, None for the defaults.

    Raises:
        DetectionError: if no pixel is left to trust.
    """
    config = config or FusionConfig()
    if len(masks) != len(frame.cameras):
        raise InvalidValueError(
            f"fuse_views() got {len(masks)} masks for {len(frame.cameras)} cameras.",
            remedy="Pass one mask for each camera, all false where nothing was found.",
        )
    clouds = [
        _view_cloud(camera, image, mask, config)
        for camera, image, mask in zip(frame.cameras, frame.images, masks, strict=True)
    ]
    cloud = concatenate_clouds(clouds)
    if len(cloud) == 0:
        marked = [int(np.count_nonzero(mask)) for mask in masks]
        raise DetectionError(
            f"No pixel of the {len(masks)} views has depth to trust: the masks mark {marked} "
            "pixels.",
            remedy="Check that the cameras see the object, and that FusionConfig.mask does not "
            "erode it away.",
        )
    if config.voxel_size > 0.0:
        cloud = voxel_downsample(cloud, config.voxel_size)
    if config.outlier_neighbours > 0:
        kept = statistical_inliers(
            cloud.points,
            neighbours=config.outlier_neighbours,
            deviations=config.outlier_deviations,
        )
        cloud = cloud.select(kept)
    return cloud


def _view_cloud(
    camera: CameraModel, image: RgbdImage, mask: np.ndarray, config: FusionConfig
) -> PointCloud:
    trusted = clean_mask(np.asarray(mask, dtype=bool), image.depth, config.mask)
    points, pixels = unproject(image.depth, camera.K, trusted)
    colors = image.rgb[pixels[:, 1], pixels[:, 0]]
    if len(points) < 3:
        return PointCloud(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3), dtype=np.uint8))
    # Untrusted pixels are left out, or differences would reach across to what is behind.
    normals_image = depth_normals(
        np.where(trusted, image.depth, np.float32(0.0)),
        camera.K,
        step=config.normal_step,
        smoothing=config.normal_smoothing,
        relative_jump=config.mask.relative_jump,
    )
    normals = normals_image[pixels[:, 1], pixels[:, 0]].astype(float)
    # Along borders, and on parts a few pixels wide, there are no central differences.
    missing = np.flatnonzero(~np.isfinite(normals).all(axis=1))
    if missing.size:
        normals[missing] = pca_normals(
            points, viewpoint=np.zeros(3), neighbours=config.normal_neighbours, at=missing
        )
    return PointCloud(points, normals, colors).transformed(camera.X_WC)

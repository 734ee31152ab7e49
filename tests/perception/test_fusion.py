import numpy as np
import pytest

from poil_drake.errors import DetectionError
from poil_drake.geometry.depth_image import DepthMaskConfig
from poil_drake.geometry.rigid_transform import inverse, make_transform
from poil_drake.perception.fusion import FusionConfig
from poil_drake.perception.fusion import fuse_views as dut
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

K = np.array([[230.0, 0, 159.5], [0, 230.0, 119.5], [0, 0, 1.0]])
CENTRE, RADIUS = np.array([0.5, 0.0, 0.1]), 0.05


def sphere_view(name, eye, color, noise=0.0):
    """Returns a camera that sees a sphere in front of a wall, its image, and the sphere's mask."""
    z = (CENTRE - eye) / np.linalg.norm(CENTRE - eye)
    x = np.cross(z, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(z, [0.0, 0.0, 1.0]))
    X_WC = make_transform(np.stack([x, np.cross(z, x), z], axis=1), eye)
    v, u = np.mgrid[:240, :320]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones((240, 320))], -1)
    centre = (inverse(X_WC) @ [*CENTRE, 1.0])[:3]
    a, b, c = np.sum(rays**2, axis=-1), rays @ centre, centre @ centre - RADIUS**2
    hit = b**2 > a * c
    depth = np.where(hit, (b - np.sqrt(np.maximum(b**2 - a * c, 0.0))) / a, 1.2)
    depth += noise * np.random.default_rng(len(name)).normal(size=depth.shape)
    rgb = np.full((240, 320, 3), color, dtype=np.uint8)
    return CameraModel(name, 320, 240, K, X_WC), RgbdImage(rgb, depth.astype(np.float32), 0.0), hit


def two_views(noise=0.0):
    views = [
        sphere_view("left", np.array([0.6, 0.5, 0.5]), 100, noise),
        sphere_view("right", np.array([0.6, -0.5, 0.5]), 200, noise),
    ]
    cameras, images, masks = zip(*views, strict=True)
    return MultiViewFrame(cameras, images), masks


def test_points_and_normals_are_those_of_the_sphere():
    frame, masks = two_views()

    cloud = dut(frame, masks)

    arms = cloud.points - CENTRE
    assert len(cloud) > 1000
    # A voxel's mean lies inside the sphere, by the curvature over a voxel.
    np.testing.assert_allclose(np.linalg.norm(arms, axis=1), RADIUS, atol=1e-4)
    outwards = arms / np.linalg.norm(arms, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(np.sum(outwards * cloud.normals, axis=1), -1.0, 1.0)))
    assert np.mean(angles) < 1.5
    assert np.max(angles) < 12.0


def test_the_cloud_has_the_colors_of_both_views():
    frame, masks = two_views()

    cloud = dut(frame, masks)

    left, right = cloud.points[:, 1] > 0.03, cloud.points[:, 1] < -0.03
    assert np.unique(cloud.colors[left]).tolist() == [100]
    assert np.unique(cloud.colors[right]).tolist() == [200]
    assert left.any()
    assert right.any()


def test_noise_is_averaged_and_stray_points_are_removed():
    frame, masks = two_views(noise=1e-3)

    cloud = dut(frame, masks)

    errors = np.linalg.norm(cloud.points - CENTRE, axis=1) - RADIUS
    assert np.sqrt(np.mean(errors**2)) < 1e-3
    assert np.max(np.abs(errors)) < 5e-3


def test_masks_that_spill_onto_the_background_add_little_of_it():
    frame, _ = two_views()
    everything = [np.ones((240, 320), dtype=bool)] * 2
    config = FusionConfig(mask=DepthMaskConfig(max_depth=1.0))

    cloud = dut(frame, everything, config)

    assert np.max(np.linalg.norm(cloud.points - CENTRE, axis=1)) < RADIUS + 1e-4


def test_every_point_can_be_kept():
    frame, masks = two_views()
    config = FusionConfig(
        voxel_size=0.0, outlier_neighbours=0, mask=DepthMaskConfig(erosion=0, edge_margin=0)
    )

    cloud = dut(frame, masks, config)

    # All but the rim of each view, which lies beside the jump to the wall.
    assert 0.9 * np.sum(masks) < len(cloud) < np.sum(masks)


def test_a_strip_too_thin_for_differences_in_only_one_view_has_normals():
    frame, masks = two_views()
    thin = np.zeros_like(masks[0])
    thin[118:121] = masks[0][118:121]
    config = FusionConfig(mask=DepthMaskConfig(erosion=0, edge_margin=0), voxel_size=0.0)

    cloud = dut(frame, [thin, np.zeros_like(thin)], config)

    outwards = (cloud.points - CENTRE) / RADIUS
    assert np.mean(np.sum(outwards * cloud.normals, axis=1)) > 0.95
    assert np.unique(cloud.colors).tolist() == [100]


def test_masks_without_pixels_are_an_error():
    frame, masks = two_views()

    with pytest.raises(DetectionError, match=r"\[0, 0\] pixels"):
        dut(frame, [np.zeros_like(mask) for mask in masks])

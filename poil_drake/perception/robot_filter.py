"""Removes the robot from depth images."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.depth_image import unproject
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import MultiViewFrame
from poil_drake.robots.panda import MAX_HAND_WIDTH
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres

_MARGIN = 0.015  # around the robot's shape [m]: noise, mixed depth at edges, calibration


def without_robot(
    frame: MultiViewFrame, model: PandaModel, q: np.ndarray, finger_opening: float
) -> MultiViewFrame:
    """Returns a frame without depth where the views show the robot.

    Args:
        frame: The views.
        model: The robot, with the pose of its base.
        q: (7,) joint positions at the time of the images [rad].
        finger_opening: Distance between the finger pads [m]; NaN if it is unknown, which counts as
            open.
    """
    opening = MAX_HAND_WIDTH if np.isnan(finger_opening) else finger_opening
    spheres = make_robot_spheres(finger_opening=opening)
    centers = spheres.world_centers(model.link_poses(q))
    tree, reach = cKDTree(centers), spheres.radii.max() + _MARGIN
    images = []
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        points, pixels = unproject(image.depth, camera.K, np.ones(image.depth.shape, dtype=bool))
        points = transform_points(camera.X_WC, points)
        near = np.flatnonzero(tree.query(points, distance_upper_bound=reach)[0] < reach)
        gaps = np.linalg.norm(points[near, None] - centers, axis=2) - spheres.radii
        u, v = pixels[near[gaps.min(axis=1, initial=np.inf) < _MARGIN]].T
        depth = image.depth.copy()
        depth[v, u] = 0.0
        images.append(replace(image, depth=depth))
    return replace(frame, images=tuple(images))

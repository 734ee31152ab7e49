"""The robot's shape as spheres, for collision checks against point clouds."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.robots.panda import ARM_LINKS
from poil_drake.robots.panda_hand import GripperGeometry
from poil_drake.robots.robot_description import panda_urdf

GRIPPER_LINK = 8
"""Index of the gripper frame among the poses of `PandaModel.link_poses`."""


@dataclass(frozen=True, kw_only=True)
class RobotSpheresConfig:
    """How finely the robot's shape is covered.

    Attributes:
        arm_spacing: Largest distance of centres along a cylinder [m]; closer spheres bulge less.
        hand_cell: Largest edge of the cells into which the hand's box is divided [m]. A sphere
            encloses each cell, so with smaller cells the spheres bulge less.
        finger_cell: Largest edge of the fingers' cells [m]; the fingers come closest to objects.
        gripper: The shape of the hand.
    """

    arm_spacing: float = 0.05
    hand_cell: float = 0.025
    finger_cell: float = 0.012
    gripper: GripperGeometry = field(default_factory=GripperGeometry)


@dataclass(frozen=True, eq=False)
class RobotSpheres:
    """Spheres that enclose the Panda, each fixed to one link.

    Attributes:
        links: (S,) index of each sphere's frame among the poses of `PandaModel.link_poses`.
        centers: (S, 3) centres in those frames [m].
        radii: (S,) radii [m].
    """

    links: np.ndarray
    centers: np.ndarray
    radii: np.ndarray

    def world_centers(self, link_poses: np.ndarray) -> np.ndarray:
        """Returns the centres (..., S, 3) in the world [m].

        Args:
            link_poses: (..., 9, 4, 4) poses from `PandaModel.link_poses`.
        """
        centers = np.empty((*link_poses.shape[:-3], len(self.links), 3))
        for link in np.unique(self.links):
            own = self.links == link
            X = link_poses[..., link, :, :]
            centers[..., own, :] = (
                self.centers[own] @ np.swapaxes(X[..., :3, :3], -1, -2) + X[..., None, :3, 3]
            )
        return centers


def make_robot_spheres(
    *, finger_opening: float | None, config: RobotSpheresConfig | None = None
) -> RobotSpheres:
    """Returns spheres that cover the arm's collision primitives and the hand's boxes.

    The description's primitives of the hand and the fingers are far thicker than the real parts,
    so the spheres cover the measured boxes of `config.gripper` instead.

    Args:
        finger_opening: Distance between the pads [m]. None leaves the fingers out, for motions in
            which they are checked elsewhere or are meant to come close to an object.
        config: How finely the shape is covered.

    Raises:
        MissingDependencyError: if the Panda's description is not installed.
    """
    config = config or RobotSpheresConfig()
    parts = [_arm_spheres(config.arm_spacing)]
    boxes = [(*config.gripper.hand_box(), config.hand_cell)]
    if finger_opening is not None:
        lower, upper = config.gripper.finger_boxes(finger_opening)
        boxes += [(low, high, config.finger_cell) for low, high in zip(lower, upper, strict=True)]
    for low, high, cell in boxes:
        centers, radius = cover_box(low, high, cell)
        links = np.full(len(centers), GRIPPER_LINK)
        parts.append((links, centers, np.full(len(centers), radius)))
    links, centers, radii = (np.concatenate(column) for column in zip(*parts, strict=True))
    return RobotSpheres(links, centers, radii)


def cover_box(lower: np.ndarray, upper: np.ndarray, cell: float) -> tuple[np.ndarray, float]:
    """Returns centres (S, 3) and the radius [m] of equal spheres that enclose a box's boundary.

    Args:
        lower: (3,) lower corner [m].
        upper: (3,) upper corner [m].
        cell: Largest edge [m] of the cells into which the box is divided. One sphere encloses each
            cell at the boundary.
    """
    counts = np.maximum(np.ceil((upper - lower) / cell).astype(int), 1)
    edges = (upper - lower) / counts
    index = np.indices(counts).reshape(3, -1).T
    boundary = np.any((index == 0) | (index == counts - 1), axis=1)
    return lower + (index[boundary] + 0.5) * edges, 0.5 * float(np.linalg.norm(edges))


def cover_cylinder(length: float, radius: float, spacing: float) -> tuple[np.ndarray, float]:
    """Returns centres (S, 3) and the radius [m] of spheres that enclose a cylinder along z.

    Args:
        length: The cylinder's length [m].
        radius: The cylinder's radius [m].
        spacing: Largest distance between centres [m].
    """
    count = max(int(np.ceil(length / spacing)), 1)
    slice_length = length / count
    z = (np.arange(count) + 0.5) * slice_length - 0.5 * length
    centers = np.stack([np.zeros(count), np.zeros(count), z], axis=1)
    return centers, float(np.hypot(radius, 0.5 * slice_length))


def _arm_spheres(spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns links, centres and radii of the spheres around the arm's collision primitives."""
    import pinocchio

    urdf = str(panda_urdf())
    model = pinocchio.buildModelFromUrdf(urdf)
    shapes = pinocchio.buildGeomFromUrdf(model, urdf, pinocchio.GeometryType.COLLISION)
    links, centers, radii = [], [], []
    for shape in shapes.geometryObjects:
        link = model.frames[shape.parentFrame].name
        if link not in ARM_LINKS:
            continue
        # A sphere is a cylinder of length zero.
        length = 2.0 * getattr(shape.geometry, "halfLength", 0.0)
        own, radius = cover_cylinder(length, shape.geometry.radius, spacing)
        links.append(np.full(len(own), ARM_LINKS.index(link)))
        centers.append(own @ shape.placement.rotation.T + shape.placement.translation)
        radii.append(np.full(len(own), radius))
    return np.concatenate(links), np.concatenate(centers), np.concatenate(radii)

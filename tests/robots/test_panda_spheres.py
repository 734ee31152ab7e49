import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_hand import GripperGeometry
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import cover_box, cover_cylinder, make_robot_spheres
from poil_drake.robots.robot_description import panda_urdf

LENGTH = st.floats(0.005, 0.3)


def assert_covered(points: np.ndarray, centers: np.ndarray, radii: np.ndarray | float) -> None:
    gaps = np.linalg.norm(points[:, None] - centers, axis=-1) - radii
    assert gaps.min(axis=1).max() <= 1e-9


def box_surface(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    points = np.random.default_rng(0).uniform(lower, upper, (300, 3))
    axis = np.arange(300) % 3
    points[np.arange(300), axis] = np.where(np.arange(300) % 2, lower[axis], upper[axis])
    return points


def cylinder_surface(radius: float, length: float) -> np.ndarray:
    rng = np.random.default_rng(0)
    angle = rng.uniform(0.0, 2.0 * np.pi, 200)
    side = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-0.5, 0.5, 200)], axis=1)
    caps = side * np.sqrt(rng.uniform(0.0, 1.0, (200, 1)))
    caps[:, 2] = np.where(np.arange(200) % 2, 0.5, -0.5)
    return np.concatenate([side, caps]) * [radius, radius, length]


@settings(max_examples=30)
@given(LENGTH, LENGTH, LENGTH, st.floats(0.01, 0.1))
def test_spheres_enclose_a_box(x: float, y: float, z: float, cell: float):
    upper = np.array([x, y, z])

    centers, radius = cover_box(np.zeros(3), upper, cell)

    assert_covered(box_surface(np.zeros(3), upper), centers, radius)


@settings(max_examples=30)
@given(LENGTH, LENGTH, st.floats(0.01, 0.1))
def test_spheres_enclose_a_cylinder(length: float, radius: float, spacing: float):
    centers, sphere_radius = cover_cylinder(length, radius, spacing)

    assert_covered(cylinder_surface(radius, length), centers, sphere_radius)


def test_spheres_enclose_the_collision_shapes_of_the_arm(model: PandaModel):
    # Pinocchio reads shapes and poses by itself; only surface points are compared.
    path = str(panda_urdf())
    full = pinocchio.buildModelFromUrdf(path)
    shapes = pinocchio.buildGeomFromUrdf(full, path, pinocchio.GeometryType.COLLISION)
    data, shape_data = full.createData(), shapes.createData()
    q = np.array([0.3, -0.5, 0.2, -2.0, 0.4, 1.8, 1.0])
    pinocchio.updateGeometryPlacements(
        full, data, shapes, shape_data, np.concatenate([q, [0.0, 0.0]])
    )

    dut = make_robot_spheres(finger_opening=0.04)

    centers = dut.world_centers(model.link_poses(q))
    checked = 0
    for shape, X_WS in zip(shapes.geometryObjects, shape_data.oMg, strict=True):
        if "hand" in shape.name or "finger" in shape.name:
            continue
        surface = cylinder_surface(
            shape.geometry.radius, 2.0 * getattr(shape.geometry, "halfLength", 0.0)
        )
        assert_covered(surface @ X_WS.rotation.T + X_WS.translation, centers, dut.radii)
        checked += 1
    assert checked >= 20


@pytest.mark.parametrize("opening", [0.0, 0.03, 0.08])
def test_spheres_enclose_hand_and_fingers(model: PandaModel, opening: float):
    gripper = GripperGeometry()
    X_WG = model.gripper_pose(NOMINAL_POSTURE)

    dut = make_robot_spheres(finger_opening=opening)

    centers = dut.world_centers(model.link_poses(NOMINAL_POSTURE))
    lower, upper = gripper.finger_boxes(opening)
    hand_lower, hand_upper = gripper.hand_box()
    for low, high in zip([*lower, hand_lower], [*upper, hand_upper], strict=True):
        surface = box_surface(low, high) @ X_WG[:3, :3].T + X_WG[:3, 3]
        assert_covered(surface, centers, dut.radii)


def test_finger_boxes_are_mirror_images_with_the_opening_between():
    lower, upper = GripperGeometry().finger_boxes(0.05)

    assert_allclose(lower[:2, 1], 0.025)
    assert_allclose(upper[2:, 1], -0.025)
    assert_allclose(lower[:2, 1] + upper[2:, 1], 0.0)
    assert_allclose(upper[:2, 1] + lower[2:, 1], 0.0)


def test_fingers_can_be_left_out():
    whole = make_robot_spheres(finger_opening=0.0)

    assert len(make_robot_spheres(finger_opening=None).radii) < len(whole.radii)

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams, Rgba
from pydrake.math import RigidTransform

from poil_drake.systems.visualization.meshcat_markers import (
    ArrowMarker,
    DrawTubes,
    SphereMarkers,
    make_tube_mesh,
)

RED = Rgba(1, 0, 0)


def test_spheres_are_drawn_once_and_hidden(spy):
    SphereMarkers(spy, "p", count=3, radius=0.01, colors=[RED])

    assert list(spy.objects) == ["p/0/0", "p/1/0", "p/2/0"]
    assert not spy.visible("p")


def test_spheres_move_except_those_at_unknown_positions(spy):
    dut = SphereMarkers(spy, "p", count=2, radius=0.01, colors=[RED])

    dut.move(np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0]]))

    assert spy.visible("p")
    np.testing.assert_array_equal(spy.poses["p/0"].translation(), [1.0, 2.0, 3.0])
    assert "p/1" not in spy.poses
    assert len(spy.objects) == 2, "nothing new is drawn"

    dut.move(np.full((2, 3), np.nan))
    assert not spy.visible("p"), "without any known position"


def test_a_sphere_shows_one_look_or_none(spy):
    dut = SphereMarkers(spy, "p", count=3, radius=0.01, colors=[RED, Rgba(0, 0, 0)])

    dut.choose_looks(np.array([0, 1, -1]))

    shown = [[spy.visible(f"p/{i}/{look}") for look in range(2)] for i in range(3)]
    assert shown == [[True, False], [False, True], [False, False]]


@pytest.mark.parametrize("direction", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [1, -2, 3]])
def test_an_arrow_reaches_from_its_start_along_its_vector(spy, direction):
    dut = ArrowMarker(spy, "a", radius=0.002, color=RED)
    start = np.array([0.1, 0.2, 0.3])
    vector = 0.2 * np.array(direction) / np.linalg.norm(direction)

    dut.show(start, vector)

    X_WA = spy.poses["a"]
    np.testing.assert_allclose(X_WA.translation(), start)
    head_at = spy.properties["a/head", "position"]
    # The cone's tip is its own origin before it is turned over and pushed up.
    X_head_cone = spy.poses["a/head/cone"]
    tip = X_WA @ RigidTransform(head_at) @ X_head_cone.translation()
    np.testing.assert_allclose(tip, start + vector, atol=1e-12)
    assert spy.properties["a/shaft", "scale"] == [1.0, 1.0, head_at[2]]


def test_a_short_arrow_has_a_smaller_head(spy):
    dut = ArrowMarker(spy, "a", radius=0.002, color=RED)

    dut.show(np.zeros(3), np.array([0.0, 0.0, 0.009]))

    assert spy.visible("a")
    assert spy.properties["a/head", "scale"] == pytest.approx([0.75] * 3)


@pytest.mark.parametrize("vector", [[0, 0, 0], [0, 0, 0.001], [np.nan, 0, 1], [0, 0, np.inf]])
def test_a_too_short_or_non_finite_arrow_is_hidden(spy, vector):
    dut = ArrowMarker(spy, "a", radius=0.002, color=RED)
    dut.show(np.zeros(3), np.array([0.0, 0.0, 1.0]))

    dut.show(np.zeros(3), np.array(vector))

    assert not spy.visible("a")


def test_a_tube_surrounds_the_curve_at_its_radius():
    t = np.linspace(0.0, 1.0, 40)
    curve = np.column_stack([np.cos(t), np.sin(t), 0.3 * t])

    vertices, faces, kept = make_tube_mesh(curve, radius=0.002)

    rings = vertices.reshape(len(kept), 6, 3)
    distance = np.linalg.norm(rings - curve[kept][:, None], axis=2)
    np.testing.assert_allclose(distance, 0.002, rtol=1e-9)
    assert len(faces) == 2 * 6 * (len(kept) - 1)
    assert faces.min() == 0
    assert faces.max() == len(vertices) - 1


def test_a_tube_faces_outward():
    curve = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

    vertices, faces, _ = make_tube_mesh(curve, radius=0.1)

    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    outward = (a + b + c) / 3.0 * [1.0, 1.0, 0.0]
    assert np.all(np.sum(normals * outward, axis=1) > 0.0)


@pytest.mark.parametrize(
    ("x", "expected_points", "num_faces"),
    [([0.0, 0.0, 1e-5, 0.1, 0.1], [0, 3], 12), ([0.0] * 5, [], 0)],
    ids=["rests at its ends", "does not move"],
)
def test_a_tube_skips_points_where_the_curve_rests(x, expected_points, num_faces):
    vertices, faces, kept = make_tube_mesh(np.outer(x, [1.0, 0.0, 0.0]), radius=0.001)

    assert kept.tolist() == expected_points
    assert vertices.shape == (6 * len(expected_points), 3)
    assert faces.shape == (num_faces, 3)


def test_tubes_are_one_object():
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    curves = np.array([[[0.0, 0, 0], [0.1, 0, 0]], [[0.0, 1, 0], [0.1, 1, 0]], np.zeros((2, 3))])

    DrawTubes(meshcat, "/tubes", curves, radius=0.001, start_color=RED, end_color=RED)

    assert meshcat.HasPath("/tubes")

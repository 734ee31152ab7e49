import math

import pytest
from pydrake.geometry import Meshcat, MeshcatParams, Rgba

from poil_drake.systems.visualization.meshcat_overlay import (
    CAMERA_PATH,
    FIELD_OF_VIEW,
    MeshcatOverlay,
)


class Spy:
    """Stands for a Meshcat: keeps the last pose and properties of each path, and the meshes."""

    def __init__(self):
        self.poses, self.properties, self.vertices = {}, {}, {}

    def SetTransform(self, path, pose):
        self.poses[path] = pose

    def SetProperty(self, path, name, value, time=None):
        self.properties[path, name] = value

    def SetTriangleMesh(self, path, vertices, faces, color):
        self.vertices[path] = vertices

    def Delete(self, path):
        pass

    def visible(self, path):
        return self.properties[path, "visible"]


@pytest.fixture
def spy():
    return Spy()


@pytest.fixture
def dut(spy):
    return MeshcatOverlay(
        spy, phase_names=["move_to_grasp", "follow"], legend={"points": Rgba(1, 0, 0)}, path="o"
    )


def test_phase_and_error_are_hidden_at_first(spy, dut):
    assert not spy.visible("o/phase")
    assert not spy.visible("o/error")


@pytest.mark.parametrize(("index", "known"), [(0, True), (1, True), (2, False), (-1, False)])
def test_a_phase_is_shown_if_it_has_a_name(spy, dut, index, known):
    dut.show_phase(index)

    assert spy.visible("o/phase") == known


def test_an_error_is_shown_in_millimetres_and_nan_is_hidden(spy, dut):
    dut.show_error(0.0056)
    assert spy.visible("o/error")
    assert spy.visible("o/error/number/place_2/5")
    assert spy.visible("o/error/number/place_3/6")

    dut.show_error(math.nan)
    assert not spy.visible("o/error")


def test_everything_fits_into_the_height_of_the_screen(spy, dut):
    distance = -spy.poses["o"].translation()[2]
    half_screen = distance * math.tan(FIELD_OF_VIEW / 2.0)

    for line in ("phase", "error", "legend"):
        height = spy.poses[f"o/{line}"].translation()[1]
        panel = spy.vertices[f"o/{line}/panel"][1]
        assert abs(height + panel.min()) < half_screen
        assert abs(height + panel.max()) < half_screen
    assert spy.properties[CAMERA_PATH, "fov"] == pytest.approx(math.degrees(FIELD_OF_VIEW))


def test_an_overlay_without_phases_and_legend_is_possible():
    meshcat = Meshcat(MeshcatParams(host="localhost"))

    MeshcatOverlay(meshcat)

    assert meshcat.HasPath(f"{CAMERA_PATH}/poil/error")
    assert not meshcat.HasPath(f"{CAMERA_PATH}/poil/legend")

import json
import math

import pytest
from pydrake.geometry import Meshcat, MeshcatParams, Rgba

from poil_drake.systems.visualization.meshcat_overlay import (
    CAMERA_PATH,
    FIELD_OF_VIEW,
    OVERLAY_PATH,
    MeshcatOverlay,
)


@pytest.fixture
def dut(spy):
    return MeshcatOverlay(
        spy, phase_names=["move_to_grasp", "follow"], legend={"points": Rgba(1, 0, 0)}
    )


@pytest.mark.parametrize(("index", "known"), [(0, True), (1, True), (2, False), (-1, False)])
def test_a_phase_is_shown_if_it_has_a_name(spy, dut, index, known):
    dut.show_phase(index)

    assert spy.visible(f"{OVERLAY_PATH}/phase") == known


@pytest.mark.parametrize(
    ("error", "digits"),
    [
        (0.0, "  00"),
        (0.00004, "  00"),
        (0.0056, "  56"),
        (0.0123, " 123"),
        (0.34567, "3457"),
        (1e3, "9999"),
    ],
)
def test_an_error_is_shown_in_millimetres(spy, dut, error, digits):
    dut.show_error(error)

    assert spy.visible(f"{OVERLAY_PATH}/error")
    shown = [
        [d for d in range(10) if spy.visible(f"{OVERLAY_PATH}/error/place_{p}/{d}")]
        for p in range(4)
    ]
    assert shown == [[] if digit == " " else [int(digit)] for digit in digits]


@pytest.mark.parametrize("error", [math.nan, math.inf])
def test_a_non_finite_error_is_hidden(spy, dut, error):
    dut.show_error(0.0056)

    dut.show_error(error)

    assert not spy.visible(f"{OVERLAY_PATH}/error")


def test_everything_fits_into_the_height_of_the_screen(spy, dut):
    distance = -spy.poses[OVERLAY_PATH].translation()[2]
    half_screen = distance * math.tan(FIELD_OF_VIEW / 2.0)

    for line in ("phase", "error", "legend"):
        height = spy.poses[f"{OVERLAY_PATH}/{line}"].translation()[1]
        panel = json.loads(
            spy.objects[f"{OVERLAY_PATH}/{line}/panel"].source().in_memory().mesh_file.contents()
        )
        half_panel = panel["accessors"][0]["max"][2]
        assert 0.0 < half_panel < half_screen - abs(height)
    assert spy.properties[CAMERA_PATH, "fov"] == pytest.approx(math.degrees(FIELD_OF_VIEW))


def test_an_overlay_without_phases_is_possible():
    meshcat = Meshcat(MeshcatParams(host="localhost"))

    MeshcatOverlay(meshcat, phase_names=(), legend={"points": Rgba(1, 0, 0)})

    assert meshcat.HasPath(f"{OVERLAY_PATH}/error")

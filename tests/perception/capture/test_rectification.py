"""Undistorting a RealSense, with a stand-in that projects as its library does."""

from types import SimpleNamespace

import numpy as np
import pytest

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.rectification import Rectification

HEIGHT, WIDTH = 90, 160
# Stronger than a D455's, to move points by many pixels.
COEFFICIENTS = [-0.2, 0.03, -0.0006, 0.0005, -0.002]


def project(intrinsics: SimpleNamespace, point: list[float]) -> list[float]:
    x, y = point[0] / point[2], point[1] / point[2]
    k1, k2, p1, p2, k3 = intrinsics.coeffs
    r2 = x * x + y * y
    f = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * f + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * f + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y)
    return [u * intrinsics.fx + intrinsics.ppx, v * intrinsics.fy + intrinsics.ppy]


LIBRARY = SimpleNamespace(rs2_project_point_to_pixel=project)


def lens(*, model: str = "inverse_brown_conrady", coeffs: list[float]) -> SimpleNamespace:
    return SimpleNamespace(
        width=WIDTH,
        height=HEIGHT,
        fx=80.0,
        fy=80.0,
        ppx=80.25,
        ppy=44.75,
        model=SimpleNamespace(name=model),
        coeffs=coeffs,
    )


@pytest.mark.parametrize(("model", "coeffs"), [("ftheta", [0.0] * 5), ("none", COEFFICIENTS)])
def test_images_without_distortion_are_unchanged(model: str, coeffs: list[float]) -> None:
    dut = Rectification(LIBRARY, lens(model=model, coeffs=coeffs), source="It")
    pixels = np.ones((HEIGHT, WIDTH), np.uint16)

    assert dut.depth(pixels) is pixels
    assert dut.color(pixels) is pixels
    np.testing.assert_array_equal(dut.K, [[80.0, 0.0, 80.25], [0.0, 80.0, 44.75], [0.0, 0.0, 1.0]])


def test_a_point_moves_to_where_a_pinhole_camera_projects_it() -> None:
    intrinsics = lens(coeffs=COEFFICIENTS)
    dut = Rectification(LIBRARY, intrinsics, source="It")
    point = [0.8, -0.45, 1.0]
    column, row = (int(x) for x in np.rint(project(intrinsics, point)))
    depth = np.zeros((HEIGHT, WIDTH), np.uint16)
    depth[row - 1 : row + 2, column - 1 : column + 2] = 700
    color = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    color[row - 1 : row + 2, column - 1 : column + 2] = 90

    v, u = round(80.0 * point[1] + 44.75), round(80.0 * point[0] + 80.25)

    assert (column, row) != (u, v)
    assert dut.depth(depth)[v, u] == 700
    assert dut.color(color)[v, u].tolist() == [90, 90, 90]


def test_depth_is_never_interpolated() -> None:
    dut = Rectification(LIBRARY, lens(coeffs=COEFFICIENTS), source="It")
    depth = np.full((HEIGHT, WIDTH), 500, np.uint16)
    depth[:, WIDTH // 2 :] = 1500

    assert set(np.unique(dut.depth(depth))) <= {0, 500, 1500}


@pytest.mark.parametrize("model", ["ftheta", "kannala_brandt4"])
def test_an_unknown_model_is_rejected(model: str) -> None:
    with pytest.raises(CaptureError, match=f"It has images distorted by the model '{model}'"):
        Rectification(LIBRARY, lens(model=model, coeffs=COEFFICIENTS), source="It")


def test_a_library_with_another_projection_is_rejected() -> None:
    def undistorted(intrinsics: SimpleNamespace, point: list[float]) -> list[float]:
        return [80.0 * point[0] + 80.25, 80.0 * point[1] + 44.75]

    library = SimpleNamespace(rs2_project_point_to_pixel=undistorted)

    with pytest.raises(CaptureError, match="is not supported"):
        Rectification(library, lens(coeffs=COEFFICIENTS), source="It")

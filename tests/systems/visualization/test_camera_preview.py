import numpy as np
import pytest

from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.visualization import camera_preview
from poil_drake.systems.visualization.camera_preview import CameraPreview, sparse_points
from poil_drake.systems.visualization.meshcat_overlay import OVERLAY_PATH

WIDTH, HEIGHT = 64, 48
K = np.array([[40.0, 0.0, 31.5], [0.0, 40.0, 23.5], [0.0, 0.0, 1.0]])
X_WC = np.diag([1.0, -1.0, -1.0, 1.0])  # Looks straight down from 0.5 m.
X_WC[:3, 3] = [0.4, 0.1, 0.5]
CAMERA = CameraModel("left", WIDTH, HEIGHT, K, X_WC)


def wall(color: int, *, depth: float = 0.5) -> RgbdImage:
    rgb = np.full((HEIGHT, WIDTH, 3), color, np.uint8)
    image = np.full((HEIGHT, WIDTH), depth, np.float32)
    image[:, :8] = 0.0
    return RgbdImage(rgb, image, 0.0)


@pytest.mark.parametrize("limit", [100, 1000, 30_000])
def test_points_lie_where_the_depth_says_and_are_at_most_as_many_as_allowed(
    monkeypatch: pytest.MonkeyPatch, limit: int
) -> None:
    monkeypatch.setattr(camera_preview, "_POINTS", limit)

    points, colors = sparse_points(CAMERA, wall(200))

    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-7)
    # Half a metre away, the image is 0.8 m wide and 0.6 m high; its first 0.1 m has no depth.
    assert np.all(np.abs(points[:, :2] - [0.45, 0.1]) <= [0.35, 0.3])
    assert np.all(colors == 200)
    assert 0.5 * min(limit, WIDTH * HEIGHT) < len(points) < 1.3 * limit


def test_each_new_image_is_drawn_once(spy, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    monkeypatch.setattr(spy, "SetLineSegments", lambda *args: drawn.append(args), raising=False)
    dut = CameraPreview(spy, [CAMERA], texts=["ready", "recording"])

    first = wall(10)
    dut.show_images({"left": None})
    assert "cameras/left/cloud" not in spy.objects
    dut.show_images({"left": first})
    cloud = spy.objects["cameras/left/cloud"]
    dut.show_images({"left": first})

    assert spy.objects["cameras/left/cloud"] is cloud
    assert np.all(cloud.rgbs() == 10)
    dut.show_images({"left": wall(20)})
    assert np.all(spy.objects["cameras/left/cloud"].rgbs() == 20)
    ((path, start, end, _, _),) = drawn
    assert path == "cameras/left/pyramid"
    # The pyramid begins at the camera and opens downwards.
    np.testing.assert_allclose(start[:, 0], X_WC[:3, 3])
    assert np.all(end[2] < 0.5)


def test_one_text_is_visible(spy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spy, "SetLineSegments", lambda *args: None, raising=False)
    dut = CameraPreview(spy, [CAMERA], texts=["ready", "recording"])

    dut.show_text("recording")

    shown = [spy.visible(f"{OVERLAY_PATH}/phase/name/{k}") for k in range(2)]
    assert shown == [False, True]

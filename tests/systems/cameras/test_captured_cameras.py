import numpy as np
import pytest
from system_bench import START, SystemBench

from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.cameras.captured_cameras import CapturedCameras

PERIOD = 1 / 256
H, W = 3, 4


class Source:
    """Replaces a capture thread."""

    newest: RgbdImage | None = None


@pytest.fixture
def left() -> Source:
    return Source()


@pytest.fixture
def right() -> Source:
    return Source()


@pytest.fixture
def bench(left: Source, right: Source) -> SystemBench:
    """Two cameras, of which the first sends labels; the loop runs 2 ms behind the clock."""
    K = np.array([[5.0, 0.0, 1.5], [0.0, 5.0, 1.0], [0.0, 0.0, 1.0]])
    dut = CapturedCameras(
        cameras=[CameraModel(name, W, H, K, np.eye(4)) for name in ("left", "right")],
        sources=[left, right],
        labels=[True, False],
        period=PERIOD,
        clock=lambda: bench.now() + 0.002,
    )
    bench = SystemBench(dut)
    return bench


def image(stamp: float, value: int = 7, *, labelled: bool = False) -> RgbdImage:
    return RgbdImage(
        rgb=np.full((H, W, 3), value, np.uint8),
        depth=np.full((H, W), 0.1 * value, np.float32),
        stamp=stamp,
        label=np.full((H, W), value, np.int16) if labelled else None,
    )


@pytest.mark.parametrize(
    "newest", [None, image(START - 0.5, labelled=True)], ids=["none", "from before the start"]
)
def test_before_the_first_image_of_the_run_there_is_none(
    bench: SystemBench, left: Source, newest: RgbdImage | None
) -> None:
    left.newest = newest
    bench.advance(3 * PERIOD)

    for kind in ("rgb_image", "depth_image", "label_image"):
        assert bench.read(f"left.{kind}").size == 0
    assert bench.read("left.rgbd_image") is ABSENT
    assert np.isnan(bench.read("left.image_time")[0])


def test_an_image_appears_with_its_age(bench: SystemBench, left: Source) -> None:
    bench.advance(64 * PERIOD)  # At 0.25 s, when the clock shows 0.252 s,
    left.newest = image(START + 0.152, labelled=True)  # an image is 0.1 s old.
    bench.advance(PERIOD)

    assert bench.read("left.image_time")[0] == pytest.approx(0.15, abs=1e-6)
    np.testing.assert_array_equal(bench.read("left.rgb_image")[:, :, :3], 7)
    np.testing.assert_allclose(bench.read("left.depth_image"), 0.7)
    assert bench.read("left.rgbd_image") is left.newest
    np.testing.assert_array_equal(bench.read("left.label_image"), 7)
    assert np.isnan(bench.read("right.image_time")[0])


def test_a_frozen_camera_keeps_its_image_and_its_time(bench: SystemBench, left: Source) -> None:
    left.newest = image(START + 0.002)
    bench.advance(PERIOD)
    first = bench.read("left.image_time")[0]

    bench.advance(100 * PERIOD)

    assert bench.read("left.image_time")[0] == first
    np.testing.assert_array_equal(bench.read("left.rgb_image")[:, :, :3], 7)


def test_newer_images_replace_older_ones(bench: SystemBench, left: Source, right: Source) -> None:
    left.newest, right.newest = image(START + 0.002), image(START + 0.002, 3)
    bench.advance(2 * PERIOD)
    left.newest = image(START + 0.008, 9)
    bench.advance(PERIOD)

    np.testing.assert_array_equal(bench.read("left.rgb_image")[:, :, :3], 9)
    np.testing.assert_array_equal(bench.read("right.rgb_image")[:, :, :3], 3)


def test_only_cameras_with_labels_have_a_port_for_them(bench: SystemBench, left: Source) -> None:
    left.newest = image(START + 0.002)  # Some images may come without labels.
    bench.advance(PERIOD)

    assert bench.read("left.label_image").size == 0
    assert not bench.dut.HasOutputPort("right.label_image")

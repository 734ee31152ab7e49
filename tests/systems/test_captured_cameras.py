import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.captured_cameras import CapturedCameras

PERIOD = 1 / 256
START = 1_790_000_000.0
H, W = 3, 4


class Source:
    """Stands for a capture thread."""

    newest: RgbdImage | None = None


class Bench:
    """The dut with two cameras, of which the first gives labels."""

    def __init__(self) -> None:
        K = np.array([[5.0, 0.0, 1.5], [0.0, 5.0, 1.0], [0.0, 0.0, 1.0]])
        models = [
            CameraModel(name=name, width=W, height=H, K=K, X_WC=np.eye(4))
            for name in ("left", "right")
        ]
        self.left, self.right = Source(), Source()
        self.dut = CapturedCameras(
            cameras=models,
            sources=[self.left, self.right],
            labels=[True, False],
            period=PERIOD,
            clock=self.now,
        )
        self.simulator = Simulator(self.dut)
        self.context = self.simulator.get_mutable_context()

    def now(self) -> float:
        # The loop runs 2 ms behind the clock.
        return START + self.context.get_time() + 0.002

    def advance(self, ticks: int = 1) -> None:
        self.simulator.AdvanceTo(self.context.get_time() + ticks * PERIOD)

    def read(self, port: str) -> np.ndarray:
        value = self.dut.GetOutputPort(port).Eval(self.context)
        return value if isinstance(value, np.ndarray) else value.data


@pytest.fixture
def bench() -> Bench:
    return Bench()


def image(stamp: float, value: int = 7, *, labelled: bool = False) -> RgbdImage:
    return RgbdImage(
        rgb=np.full((H, W, 3), value, np.uint8),
        depth=np.full((H, W), 0.1 * value, np.float32),
        stamp=stamp,
        label=np.full((H, W), value, np.int16) if labelled else None,
    )


def test_before_the_first_image_there_is_none(bench: Bench) -> None:
    bench.advance(3)

    assert bench.read("left.rgb_image").size == 0
    assert bench.read("left.depth_image").size == 0
    assert bench.read("left.label_image").size == 0
    assert np.isnan(bench.read("left.image_time")[0])


def test_an_image_appears_with_its_age(bench: Bench) -> None:
    bench.advance(64)  # At 0.25 s, when the clock shows 0.252 s,
    bench.left.newest = image(START + 0.152, labelled=True)  # an image is 0.1 s old.
    bench.advance()

    assert bench.read("left.image_time")[0] == pytest.approx(0.15, abs=1e-6)
    np.testing.assert_array_equal(bench.read("left.rgb_image")[:, :, :3], 7)
    np.testing.assert_allclose(bench.read("left.depth_image"), 0.7)
    np.testing.assert_array_equal(bench.read("left.label_image"), 7)
    assert np.isnan(bench.read("right.image_time")[0])


def test_an_image_from_before_the_start_does_not_appear(bench: Bench) -> None:
    bench.left.newest = image(START - 0.5)
    bench.advance(2)

    assert bench.read("left.rgb_image").size == 0
    assert np.isnan(bench.read("left.image_time")[0])


def test_a_frozen_camera_keeps_its_image_and_its_time(bench: Bench) -> None:
    bench.left.newest = image(START + 0.002)
    bench.advance()
    first = bench.read("left.image_time")[0]

    bench.advance(100)

    assert bench.read("left.image_time")[0] == first
    np.testing.assert_array_equal(bench.read("left.rgb_image")[:, :, :3], 7)


def test_newer_images_take_the_place_of_older_ones(bench: Bench) -> None:
    bench.left.newest, bench.right.newest = image(START + 0.002), image(START + 0.002, 3)
    bench.advance(2)
    bench.left.newest = image(START + 0.008, 9)
    bench.advance()

    np.testing.assert_array_equal(bench.read("left.rgb_image")[:, :, :3], 9)
    np.testing.assert_array_equal(bench.read("right.rgb_image")[:, :, :3], 3)


def test_an_image_without_labels_has_an_empty_label_image(bench: Bench) -> None:
    bench.left.newest = image(START + 0.002)
    bench.advance()

    assert bench.read("left.label_image").size == 0


def test_only_cameras_that_give_labels_have_a_port_for_them(bench: Bench) -> None:
    assert bench.dut.HasOutputPort("left.label_image")
    assert not bench.dut.HasOutputPort("right.label_image")

import threading
from concurrent.futures import wait

import numpy as np
import pytest
from network_bench import free_url
from pydrake.lcm import DrakeLcm
from system_bench import START, SystemBench

from poil_drake.errors import CaptureError, NoImageError
from poil_drake.perception.images import RgbdImage
from poil_drake.systems.cameras import lcm_cameras
from poil_drake.systems.cameras.lcm_cameras import LcmCameraFeed, LcmImageDevice
from poil_drake.systems.cameras.lcm_image_messages import decode_images, encode_images
from poil_drake.systems.lcm.network import LcmNetwork

PERIOD = 1 / 8
H, W = 3, 4


class Renderer:
    """Renders the first position as the colour, once `go` is set."""

    def __init__(self) -> None:
        self.go, self.begun = threading.Event(), threading.Event()
        self.go.set()
        self.scenes: list[float] = []

    def render(self, positions: np.ndarray, time: float) -> tuple[RgbdImage, ...]:
        self.begun.set()
        self.go.wait()
        self.scenes.append(time)
        rgb = np.full((H, W, 3), int(positions[0]), np.uint8)
        return (RgbdImage(rgb=rgb, depth=np.ones((H, W), np.float32), stamp=time),)

    def render_labels(self, positions: np.ndarray, time: float) -> tuple[np.ndarray, ...]:
        return (np.full((H, W), 5, np.int16),)


class FeedBench(SystemBench):
    """The dut and a receiver of its images."""

    def __init__(self) -> None:
        url = free_url()
        self.renderer = Renderer()
        dut = LcmCameraFeed(
            renderer=self.renderer,
            channels={"left": "LEFT"},
            url=url,
            num_positions=2,
            num_velocities=1,
            period=PERIOD,
            clock=self.now,
        )
        super().__init__(dut, plant_state=[7.0, 0.0, 0.0])
        self.network, self.got = LcmNetwork(url), []
        self.network.Subscribe("LEFT", self.got.append)

    def wait_for_renderer(self) -> None:
        """Keeps the next capture from being skipped while the renderer is busy."""
        wait([self.dut._work])

    def receive(self, count: int) -> list[RgbdImage]:
        while len(self.got) < count:
            self.network.HandleSubscriptions(100)
        return [decode_images(message, size=(H, W)) for message in self.got]


@pytest.fixture
def bench() -> FeedBench:
    return FeedBench()


def test_images_go_out_with_the_clock_of_their_capture(bench: FeedBench) -> None:
    bench.advance(PERIOD)

    image = bench.receive(1)[0]

    np.testing.assert_array_equal(image.rgb, 7)
    assert image.stamp - START in (0.0, PERIOD)  # Drake may also publish at the start.


def test_only_some_messages_have_labels(bench: FeedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lcm_cameras, "_LABEL_EVERY", 2)
    while len(bench.got) < 4:
        bench.advance(PERIOD)
        bench.wait_for_renderer()
        bench.receive(len(bench.got) + 1)

    labelled = [image.label is not None for image in bench.receive(4)]

    assert labelled[:4] == [True, False, True, False]


def test_captures_are_skipped_while_images_are_rendered(bench: FeedBench) -> None:
    bench.renderer.go.clear()
    for _ in range(4):
        bench.advance(PERIOD)  # Would never return if it waited for the renderer.
    bench.renderer.begun.wait()
    bench.renderer.go.set()
    bench.dut.close()  # Finishes the images in progress.

    assert len(bench.renderer.scenes) == 1
    assert len(bench.receive(1)) == 1


def test_an_error_of_the_renderer_ends_the_simulation(bench: FeedBench) -> None:
    def fail(positions: np.ndarray, time: float) -> tuple[RgbdImage, ...]:
        raise ZeroDivisionError

    bench.renderer.render = fail  # type: ignore[method-assign]

    def render_and_capture_again() -> None:
        bench.advance(PERIOD)
        bench.wait_for_renderer()
        bench.dut.close()
        bench.advance(PERIOD)

    with pytest.raises(ZeroDivisionError):
        render_and_capture_again()


def message(stamp: float) -> bytes:
    rgb, depth = np.zeros((H, W, 3), np.uint8), np.ones((H, W), np.float32)
    return encode_images(RgbdImage(rgb, depth, stamp), camera="left")


@pytest.fixture
def url() -> str:
    return free_url()


@pytest.fixture
def dut(url: str, monkeypatch: pytest.MonkeyPatch) -> LcmImageDevice:
    monkeypatch.setattr(lcm_cameras, "_PATIENCE", 3_600_000)
    return LcmImageDevice(url=url, channel="CAMERA", size=(H, W))


def test_images_of_the_channel_are_read(dut: LcmImageDevice, url: str) -> None:
    dut.open()
    dut.close()
    dut.close()
    dut.open()  # It can be opened again.
    sender = DrakeLcm(url)
    sender.Publish("OTHER", message(9.0))
    sender.Publish("CAMERA", message(1.0))

    found = dut.read()

    assert found is not None
    assert found.stamp == 1.0


@pytest.mark.parametrize(
    ("every_image", "stamps"), [(False, [3.0, None, None]), (True, [1.0, 2.0, 3.0])]
)
def test_of_three_queued_images_the_newest_or_every_one_is_read(
    monkeypatch: pytest.MonkeyPatch, every_image: bool, stamps: list[float | None]
) -> None:
    networks: list[LcmNetwork] = []

    class Kept(LcmNetwork):
        def __init__(self, url: str, *, queue_capacity: int):
            super().__init__(url, queue_capacity=queue_capacity)
            networks.append(self)

    monkeypatch.setattr(lcm_cameras, "LcmNetwork", Kept)
    # In memory, so that all three are queued before the first is read.
    monkeypatch.setattr(lcm_cameras, "_PATIENCE", 100)
    dut = LcmImageDevice(url="memq://", channel="CAMERA", size=(H, W), every_image=every_image)
    dut.open()
    for stamp in (1.0, 2.0, 3.0):
        networks[0].Publish("CAMERA", message(stamp))

    found = [dut.read() for _ in stamps]

    assert [None if image is None else image.stamp for image in found] == stamps


def test_a_silent_channel_has_no_image(
    dut: LcmImageDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lcm_cameras, "_PATIENCE", 100)
    dut.open()

    assert dut.read() is None


def test_garbage_is_reported_and_the_next_image_is_read(dut: LcmImageDevice, url: str) -> None:
    dut.open()
    sender = DrakeLcm(url)
    sender.Publish("CAMERA", b"garbage")
    with pytest.raises(NoImageError, match="no lcmt_image_array"):
        dut.read()
    sender.Publish("CAMERA", message(2.0))

    found = dut.read()

    assert found is not None
    assert found.stamp == 2.0


def test_it_must_be_open_to_be_read(dut: LcmImageDevice) -> None:
    with pytest.raises(CaptureError, match="CAMERA is not open"):
        dut.read()

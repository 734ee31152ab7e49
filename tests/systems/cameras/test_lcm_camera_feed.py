import threading
from concurrent.futures import wait

import numpy as np
import pytest
from network_bench import free_url
from system_bench import START, SystemBench

from poil_drake.perception.images import RgbdImage
from poil_drake.systems.cameras.lcm_camera_feed import LcmCameraFeed
from poil_drake.systems.cameras.lcm_image_messages import decode_images
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
            cameras=["left"],
            channels=["LEFT"],
            url=url,
            num_positions=2,
            num_velocities=1,
            period=PERIOD,
            label_every=2,
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


def test_every_second_message_has_labels(bench: FeedBench) -> None:
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

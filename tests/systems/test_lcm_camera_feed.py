import socket
import threading
from concurrent.futures import wait

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.perception.images import RgbdImage
from poil_drake.systems.lcm_camera_feed import LcmCameraFeed
from poil_drake.systems.lcm_image_messages import decode_images
from poil_drake.systems.lcm_network import LcmNetwork

PERIOD = 1 / 8
START = 1_790_000_000.0
H, W = 3, 4


class Renderer:
    """Renders the first position as the colour, when it may go on."""

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


class Bench:
    """The dut and somebody who receives."""

    def __init__(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("", 0))
            url = f"udpm://239.255.76.67:{taken.getsockname()[1]}?ttl=0"
        self.renderer = Renderer()
        self.dut = LcmCameraFeed(
            renderer=self.renderer,
            cameras=["left"],
            channels=["LEFT"],
            url=url,
            num_positions=2,
            num_velocities=1,
            period=PERIOD,
            label_every=2,
            clock=lambda: START + self.context.get_time(),
        )
        self.simulator = Simulator(self.dut)
        self.context = self.simulator.get_mutable_context()
        self.network, self.got = LcmNetwork(url), []
        self.network.Subscribe("LEFT", self.got.append)
        self.dut.GetInputPort("plant_state").FixValue(self.context, [7.0, 0.0, 0.0])

    def capture(self) -> None:
        self.simulator.AdvanceTo(self.context.get_time() + PERIOD)

    def wait_for_renderer(self) -> None:
        """Otherwise the next capture may find it busy still, and be left out."""
        wait([self.dut._work])

    def receive(self, count: int) -> list[RgbdImage]:
        while len(self.got) < count and self.network.HandleSubscriptions(5000):
            pass
        return [decode_images(message, size=(H, W)) for message in self.got]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_images_go_out_with_the_clock_of_their_capture(bench: Bench) -> None:
    bench.capture()

    image = bench.receive(1)[0]

    np.testing.assert_array_equal(image.rgb, 7)
    assert image.stamp - START in (0.0, PERIOD)  # Drake may publish at the start, too.


def test_labels_come_along_every_so_often(bench: Bench) -> None:
    while len(bench.got) < 4:
        bench.capture()
        bench.wait_for_renderer()
        bench.receive(len(bench.got) + 1)

    labelled = [image.label is not None for image in bench.receive(4)]

    assert labelled[:4] == [True, False, True, False]


def test_captures_are_left_out_while_images_are_rendered(bench: Bench) -> None:
    bench.renderer.go.clear()
    for _ in range(4):
        bench.capture()  # would never come back if it waited for the renderer
    assert bench.renderer.begun.wait(10.0)
    bench.renderer.go.set()
    bench.dut.close()  # the images in hand are finished first

    assert len(bench.renderer.scenes) == 1
    assert len(bench.receive(1)) == 1


def test_what_the_renderer_meets_ends_the_simulation(bench: Bench) -> None:
    def fail(positions: np.ndarray, time: float) -> tuple[RgbdImage, ...]:
        raise ZeroDivisionError

    bench.renderer.render = fail  # type: ignore[method-assign]

    def render_and_capture_again() -> None:
        bench.capture()
        wait([bench.dut._work])
        bench.dut.close()
        bench.capture()

    with pytest.raises(ZeroDivisionError):
        render_and_capture_again()

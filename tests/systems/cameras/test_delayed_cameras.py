import threading
from collections.abc import Iterator

import numpy as np
import pytest
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from system_bench import SystemBench

from poil_drake.errors import InvalidValueError, StationError
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.cameras.camera_ports import CameraPorts
from poil_drake.systems.cameras.delayed_cameras import DelayedCameras

PERIOD = 1 / 8
AFTER = 1 / 1024  # long enough after an event to see what it did
W, H = 4, 3
CAMERAS = [
    CameraModel(name, W, H, np.diag([5.0, 5.0, 1.0]), np.eye(4)) for name in ("left", "right")
]


class Moving(LeafSystem):
    """A plant with two positions, the first of them the time, and one velocity."""

    def __init__(self, spoilt_at: float | None = None):
        super().__init__()
        self._spoilt_at = spoilt_at
        self.DeclareVectorOutputPort("state", 3, self._calc, {self.time_ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        time = context.get_time()
        output.SetFromVector([np.nan if time == self._spoilt_at else time, 2.0, 100.0])


class Painter:
    """A renderer whose images encode its arguments: depth is position, view, and sum."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.go.set()
        self.labels_of: list[float] = []

    def render(self, positions: np.ndarray, time: float) -> tuple[RgbdImage, ...]:
        self.go.wait()
        assert positions.shape == (2,)
        return tuple(
            RgbdImage(
                rgb=np.full((H, W, 3), 10 + view, np.uint8),
                depth=np.full((H, W), 1.0 + positions[0] + view, np.float32),
                stamp=time,
            )
            for view in range(2)
        )

    def render_labels(self, positions: np.ndarray, time: float) -> tuple[np.ndarray, ...]:
        self.labels_of.append(time)
        return tuple(np.full((H, W), 5 + view, np.int16) for view in range(2))


def make_bench(
    *,
    delay: float,
    painter: Painter | None = None,
    plant: Moving | None = None,
    stopwatch: Stopwatch | None = None,
) -> SystemBench:
    """The cameras, connected to a moving plant."""
    dut = DelayedCameras(
        renderer=painter or Painter(),
        cameras=CAMERAS,
        num_positions=2,
        num_velocities=1,
        period=PERIOD,
        delay=delay,
        stopwatch=stopwatch,
    )
    builder = DiagramBuilder()
    plant = builder.AddSystem(plant or Moving())
    builder.AddSystem(dut)
    builder.Connect(plant.get_output_port(), dut.GetInputPort("plant_state"))
    return SystemBench(dut, builder.Build())


@pytest.fixture
def painter() -> Painter:
    return Painter()


@pytest.fixture
def bench(painter: Painter) -> Iterator[SystemBench]:
    bench = make_bench(delay=3 / 32, painter=painter)
    yield bench
    bench.dut.close()


def test_before_the_first_image_is_due_there_is_none(bench: SystemBench) -> None:
    bench.advance_to(3 / 32)

    for camera in ("left", "right"):
        for kind in ("rgb_image", "depth_image", "label_image"):
            assert bench.read(f"{camera}.{kind}").size == 0
        assert np.isnan(bench.read(f"{camera}.image_time")).all()


def test_images_are_of_the_moment_of_their_capture(bench: SystemBench) -> None:
    bench.advance_to(PERIOD + 3 / 32 + AFTER)

    for view, camera in enumerate(("left", "right")):
        assert bench.read(f"{camera}.image_time") == PERIOD
        np.testing.assert_array_equal(
            bench.read(f"{camera}.depth_image"), np.full((H, W, 1), 1.0 + PERIOD + view)
        )
        rgba = bench.read(f"{camera}.rgb_image")
        assert rgba.shape == (H, W, 4)
        assert (rgba[..., :3] == 10 + view).all()
        assert (rgba[..., 3] == 255).all()
        assert (bench.read(f"{camera}.label_image") == 5 + view).all()


def test_labels_are_rendered_of_the_images_shown_and_only_when_wanted(
    bench: SystemBench, painter: Painter
) -> None:
    bench.advance_to(0.5)
    assert painter.labels_of == []

    bench.read("left.label_image")

    bench.read("right.label_image")

    assert painter.labels_of == [0.375], "once for all cameras"


def test_the_simulation_continues_until_images_are_due_and_then_waits_for_them(
    bench: SystemBench, painter: Painter
) -> None:
    painter.go.clear()
    bench.advance_to(3 / 32)  # would never come back if it waited at the capture

    # Another thread lets the renderer continue, a while after the release has begun to wait.
    threading.Timer(0.05, painter.go.set).start()
    bench.advance_to(3 / 32 + AFTER)

    assert painter.go.is_set()
    assert bench.read("left.image_time") == 0.0


def test_what_is_not_a_number_is_not_rendered() -> None:
    bench = make_bench(delay=1 / 16, plant=Moving(spoilt_at=2 * PERIOD))

    bench.advance_to(2 * PERIOD + 1 / 16 + AFTER)
    assert bench.read("left.image_time") == PERIOD, "the last image stays, and ages"
    bench.advance_to(3 * PERIOD + 1 / 16 + AFTER)
    assert bench.read("left.image_time") == 3 * PERIOD
    bench.dut.close()


def test_a_context_that_is_reset_shows_nothing_of_the_run_before(bench: SystemBench) -> None:
    bench.advance_to(0.5)
    assert bench.read("left.rgb_image").size > 0
    bench.read("left.label_image")
    root = bench.simulator.get_mutable_context()

    bench.simulator.get_system().SetDefaultContext(root)
    root.SetTime(0.0)
    bench.simulator.Initialize()

    for kind in ("rgb_image", "depth_image", "label_image"):
        assert bench.read(f"left.{kind}").size == 0
    assert np.isnan(bench.read("left.image_time"))
    bench.advance_to(3 / 32 + AFTER)
    assert bench.read("left.image_time") == 0.0


def test_after_closing_an_error_names_what_was_closed(bench: SystemBench) -> None:
    bench.advance_to(PERIOD)
    bench.dut.close()

    with pytest.raises(StationError, match=r"has been closed.*Close the loop after"):
        bench.advance_to(PERIOD + AFTER)


def test_nothing_feeds_through(bench: SystemBench) -> None:
    assert not bench.dut.HasAnyDirectFeedthrough()


def test_a_consumer_gets_whole_frames_with_the_time_of_capture(bench: SystemBench) -> None:
    class Onlooker(LeafSystem):
        def __init__(self) -> None:
            super().__init__()
            self.ports = CameraPorts(system=self, cameras=CAMERAS, label_ids={"mug": (5, 6)})

    onlooker = SystemBench(Onlooker())
    bench.advance_to(1 / 4)
    for camera in ("left", "right"):
        for kind in ("rgb_image", "depth_image", "label_image", "image_time"):
            port = bench.dut.GetOutputPort(f"{camera}.{kind}")
            onlooker.fix(port.get_name(), port.Eval(bench.context))

    frame = onlooker.dut.ports.capture(onlooker.context)

    assert frame is not None
    assert frame.stamp == PERIOD
    assert [image.depth[0, 0] for image in frame.images] == [1.125, 2.125]


@pytest.mark.parametrize("delay", [0.0, -0.1, np.nan, 1e-17])
def test_cameras_without_a_delay_are_refused(delay: float) -> None:
    with pytest.raises(InvalidValueError, match="delay"):
        make_bench(delay=delay)

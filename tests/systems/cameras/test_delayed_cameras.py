import threading
from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from system_bench import SystemBench

from poil_drake.errors import InvalidValueError, StationError
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.cameras.delayed_cameras import DelayedCameras

PERIOD = 1 / 8
AFTER = 1 / 1024  # Long enough after an event to see its effect.
W, H = 4, 3
VIEWS = {"left": 0, "right": 1, "top": 2}
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
    """A renderer whose images show its arguments: depth is 1 m + position + view.

    It answers in another order than that of the cameras.
    """

    def __init__(self, names: Sequence[str] = ("right", "left")) -> None:
        self.names = names
        self.threads: set[int] = set()
        self.labels_of: list[float] = []

    def render(self, positions: np.ndarray, time: float) -> dict[str, RgbdImage]:
        self.threads.add(threading.get_ident())
        assert positions.shape == (2,)
        return {
            name: RgbdImage(
                rgb=np.full((H, W, 3), 10 + view, np.uint8),
                depth=np.full((H, W), 1.0 + positions[0] + view, np.float32),
                stamp=time,
            )
            for name in self.names
            for view in [VIEWS[name]]
        }

    def render_labels(self, positions: np.ndarray, time: float) -> dict[str, np.ndarray]:
        self.labels_of.append(time)
        return {name: np.full((H, W), 5 + VIEWS[name], np.int16) for name in self.names}


def make_bench(
    *, delay: float, painter: Painter | None = None, plant: Moving | None = None
) -> SystemBench:
    """The cameras, connected to a moving plant."""
    dut = DelayedCameras(
        renderer=painter or Painter(),
        cameras=CAMERAS,
        num_positions=2,
        num_velocities=1,
        period=PERIOD,
        delay=delay,
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
    assert not bench.dut.HasAnyDirectFeedthrough()

    bench.advance_to(3 / 32)

    for camera in ("left", "right"):
        for kind in ("rgb_image", "depth_image", "label_image"):
            assert bench.read(f"{camera}.{kind}").size == 0
        assert np.isnan(bench.read(f"{camera}.image_time")).all()


def test_images_show_the_time_of_their_capture(bench: SystemBench) -> None:
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


@pytest.mark.parametrize("names", [("left",), ("left", "right", "top"), ("left", "top")])
def test_images_of_other_cameras_are_refused(names: tuple[str, ...]) -> None:
    bench = make_bench(delay=1 / 16, painter=Painter(names))

    with pytest.raises(InvalidValueError, match="but the cameras are 'left', 'right'"):
        bench.advance_to(PERIOD)
    bench.dut.close()


def test_labels_of_the_shown_images_are_rendered_only_when_evaluated(
    bench: SystemBench, painter: Painter
) -> None:
    bench.advance_to(0.5)
    assert painter.labels_of == []

    bench.read("left.label_image")
    bench.read("right.label_image")

    assert painter.labels_of == [0.375], "once for all cameras"


def test_images_are_rendered_beside_the_simulation(bench: SystemBench, painter: Painter) -> None:
    bench.advance_to(0.5)

    assert len(painter.threads) == 1
    assert threading.get_ident() not in painter.threads


def test_a_state_that_is_not_finite_is_not_rendered() -> None:
    bench = make_bench(delay=1 / 16, plant=Moving(spoilt_at=2 * PERIOD))

    bench.advance_to(2 * PERIOD + 1 / 16 + AFTER)
    assert bench.read("left.image_time") == PERIOD, "the last image stays"
    bench.advance_to(3 * PERIOD + 1 / 16 + AFTER)
    assert bench.read("left.image_time") == 3 * PERIOD
    bench.dut.close()


def test_a_reset_context_shows_no_images_of_the_last_run(bench: SystemBench) -> None:
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


def test_an_error_names_the_closed_thread(bench: SystemBench) -> None:
    bench.advance_to(PERIOD)
    bench.dut.close()

    with pytest.raises(StationError, match=r"has been closed.*Close the loop only after"):
        bench.advance_to(PERIOD + AFTER)

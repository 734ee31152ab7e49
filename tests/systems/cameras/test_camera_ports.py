import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U
from system_bench import SystemBench

from poil_drake.errors import StationError
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.cameras.camera_ports import CameraPorts

W, H = 4, 3
K = np.array([[5.0, 0.0, 1.5], [0.0, 5.0, 1.0], [0.0, 0.0, 1.0]])
CAMERAS = [
    CameraModel(name=name, width=W, height=H, K=K, X_WC=np.eye(4)) for name in ("left", "right")
]
LABEL_IDS = {"mug": (7, 8)}


class Viewer(LeafSystem):
    """A system with nothing but cameras."""

    def __init__(self) -> None:
        super().__init__()
        self.cameras = CameraPorts(system=self, cameras=CAMERAS, label_ids=LABEL_IDS)


class ViewerBench(SystemBench):
    """The viewer, which sees an image of each camera."""

    def __init__(self) -> None:
        super().__init__(Viewer())
        for number, camera in enumerate(("left", "right")):
            rgba, depth = ImageRgba8U(W, H), ImageDepth32F(W, H)
            rgba.mutable_data[:] = 10 * number + np.arange(4)
            depth.mutable_data[:, :, 0] = 0.5
            depth.mutable_data[0, :2, 0] = np.inf, np.nan
            self.fix(f"{camera}.rgb_image", rgba)
            self.fix(f"{camera}.depth_image", depth)

    def capture(self) -> MultiViewFrame:
        frame = self.dut.cameras.capture(self.context)
        assert frame is not None
        return frame


@pytest.fixture
def bench() -> ViewerBench:
    return ViewerBench()


def test_a_frame_holds_the_images_at_the_ports(bench: ViewerBench) -> None:
    bench.context.SetTime(1.25)

    frame = bench.capture()

    assert frame.stamp == 1.25
    assert [camera.name for camera in frame.cameras] == ["left", "right"]
    for number, image in enumerate(frame.images):
        np.testing.assert_array_equal(image.rgb[1, 2], 10 * number + np.arange(3))
        # Depth that is not finite is unmeasured.
        np.testing.assert_array_equal(image.depth[0], np.float32([0.0, 0.0, 0.5, 0.5]))
        assert image.label is None
    assert frame.label_ids == {}


def test_frames_do_not_change_when_the_ports_do(bench: ViewerBench) -> None:
    frame = bench.capture()
    before = frame.images[0].rgb.copy()

    bench.fix("left.rgb_image", ImageRgba8U(W, H))
    bench.capture()

    np.testing.assert_array_equal(frame.images[0].rgb, before)
    assert not frame.images[0].rgb.flags.writeable


def test_labels_are_included_where_connected(bench: ViewerBench) -> None:
    for number, camera in enumerate(("left", "right")):
        label = ImageLabel16I(W, H)
        label.mutable_data[:] = 7 + number
        bench.fix(f"{camera}.label_image", label)

    frame = bench.capture()

    assert frame.label_ids == LABEL_IDS
    assert [int(image.label[0, 0]) for image in frame.images] == [7, 8]


def test_the_stamp_is_the_images_where_it_is_known(bench: ViewerBench) -> None:
    bench.context.SetTime(2.0)
    bench.fix("left.image_time", 1.75)

    frame = bench.capture()

    assert [image.stamp for image in frame.images] == [1.75, 2.0]
    assert frame.stamp == 1.75


def test_whole_images_replace_drakes_and_get_the_stamp_of_the_port(bench: ViewerBench) -> None:
    whole = RgbdImage(np.full((H, W, 3), 9, np.uint8), np.full((H, W), 0.7, np.float32), 1e9)
    bench.fix("left.rgbd_image", whole)
    bench.fix("left.image_time", 1.75)

    left, right = bench.capture().images

    assert left.rgb is whole.rgb
    assert left.depth is whole.depth
    assert left.stamp == 1.75
    np.testing.assert_array_equal(right.rgb[1, 2], 10 + np.arange(3))
    bench.fix("left.rgbd_image", ABSENT)
    assert bench.dut.cameras.capture(bench.context) is None


def test_before_the_first_image_there_is_no_frame(bench: ViewerBench) -> None:
    bench.fix("right.depth_image", ImageDepth32F())

    assert bench.dut.cameras.capture(bench.context) is None


def test_cameras_that_are_not_connected_are_named() -> None:
    dut = Viewer()

    with pytest.raises(StationError, match="'left'"):
        dut.cameras.capture(dut.CreateDefaultContext())

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

from poil_drake.errors import StationError
from poil_drake.perception.images import CameraModel
from poil_drake.systems.cameras.camera_ports import CameraPorts

W, H = 4, 3
K = np.array([[5.0, 0.0, 1.5], [0.0, 5.0, 1.0], [0.0, 0.0, 1.0]])
CAMERAS = [
    CameraModel(name=name, width=W, height=H, K=K, X_WC=np.eye(4)) for name in ("left", "right")
]


class Viewer(LeafSystem):
    """A system with nothing but cameras."""

    def __init__(self, label_ids: dict[str, tuple[int, ...]] | None = None):
        super().__init__()
        self.cameras = CameraPorts(system=self, cameras=CAMERAS, label_ids=label_ids)


def fix_images(dut: Viewer, context: Context, *, labels: bool = False) -> None:
    for number, camera in enumerate(("left", "right")):
        rgba, depth, label = ImageRgba8U(W, H), ImageDepth32F(W, H), ImageLabel16I(W, H)
        rgba.mutable_data[:] = 10 * number + np.arange(4)
        depth.mutable_data[:, :, 0] = 0.5
        depth.mutable_data[0, 0, 0] = np.inf
        depth.mutable_data[0, 1, 0] = np.nan
        label.mutable_data[:, :, 0] = 7 + number
        dut.GetInputPort(f"{camera}.rgb_image").FixValue(context, Value(rgba))
        dut.GetInputPort(f"{camera}.depth_image").FixValue(context, Value(depth))
        if labels:
            dut.GetInputPort(f"{camera}.label_image").FixValue(context, Value(label))


def test_a_frame_holds_what_the_ports_show() -> None:
    dut = Viewer()
    context = dut.CreateDefaultContext()
    fix_images(dut, context)
    context.SetTime(1.25)

    frame = dut.cameras.capture(context)

    assert frame is not None
    assert frame.stamp == 1.25
    assert [camera.name for camera in frame.cameras] == ["left", "right"]
    for number, image in enumerate(frame.images):
        np.testing.assert_array_equal(image.rgb[1, 2], 10 * number + np.arange(3))
        assert image.depth[1, 1] == np.float32(0.5)
        assert image.label is None
    assert frame.label_ids == {}


def test_depth_that_is_not_finite_becomes_zero() -> None:
    dut = Viewer()
    context = dut.CreateDefaultContext()
    fix_images(dut, context)

    frame = dut.cameras.capture(context)

    assert frame is not None
    np.testing.assert_array_equal(frame.images[0].depth[0], [0.0, 0.0, 0.5, 0.5])


def test_frames_do_not_change_when_the_ports_do() -> None:
    dut = Viewer()
    context = dut.CreateDefaultContext()
    fix_images(dut, context)
    frame = dut.cameras.capture(context)
    assert frame is not None
    before = frame.images[0].rgb.copy()

    dut.GetInputPort("left.rgb_image").FixValue(context, Value(ImageRgba8U(W, H)))
    dut.cameras.capture(context)

    np.testing.assert_array_equal(frame.images[0].rgb, before)
    assert not frame.images[0].rgb.flags.writeable


def test_labels_are_taken_along_where_connected() -> None:
    label_ids = {"mug": (7, 8)}
    dut = Viewer(label_ids)
    with_labels, without = dut.CreateDefaultContext(), dut.CreateDefaultContext()
    fix_images(dut, with_labels, labels=True)
    fix_images(dut, without)

    labelled, plain = dut.cameras.capture(with_labels), dut.cameras.capture(without)

    assert labelled is not None and plain is not None  # noqa: PT018
    assert labelled.label_ids == label_ids
    assert [int(image.label[0, 0]) for image in labelled.images] == [7, 8]
    assert plain.label_ids == {}


def test_the_stamp_is_the_images_where_it_is_known() -> None:
    dut = Viewer()
    context = dut.CreateDefaultContext()
    fix_images(dut, context)
    context.SetTime(2.0)
    dut.GetInputPort("left.image_time").FixValue(context, [1.75])

    frame = dut.cameras.capture(context)

    assert frame is not None
    assert [image.stamp for image in frame.images] == [1.75, 2.0]
    assert frame.stamp == 1.75


def test_before_the_first_image_there_is_no_frame() -> None:
    dut = Viewer()
    context = dut.CreateDefaultContext()
    fix_images(dut, context)
    dut.GetInputPort("right.depth_image").FixValue(context, Value(ImageDepth32F()))

    assert dut.cameras.capture(context) is None


def test_cameras_that_are_not_connected_are_named() -> None:
    dut = Viewer()
    context = dut.CreateDefaultContext()

    with pytest.raises(StationError, match="'left'"):
        dut.cameras.capture(context)

"""Faults, on small frames whose faulty images can be worked out by hand."""

import numpy as np
import pytest
from small_frames import HEIGHT, WIDTH, image, make_frame

from poil_drake.errors import InvalidValueError
from poil_drake.perception.faults.delivery import (
    DelayedFrames,
    DroppedFrames,
    FrozenFrames,
    SwappedFrames,
)
from poil_drake.perception.faults.extrinsics import ExtrinsicsError
from poil_drake.perception.faults.injector import Fault, FaultInjector
from poil_drake.perception.faults.scene import DepthError, DepthHoles, LightChange, Occluder
from poil_drake.perception.faults.surface import (
    GlossyObject,
    TransparentObject,
    UntexturedObject,
)
from poil_drake.perception.images import MultiViewFrame, RgbdImage

EMPTY_LABEL = 32767


def inject(*faults: Fault, frames: int = 4, labelled: bool = False) -> list[MultiViewFrame]:
    """The frames at 0, 1/8, 2/8 ... s with the faults."""
    dut = FaultInjector(faults, object_label="mug")
    return [dut.apply(make_frame(index, labelled=labelled)) for index in range(frames)]


def shown(frames: list[MultiViewFrame], view: int = 0) -> list[int]:
    """The index of the image that each frame shows."""
    return [round((int(f.images[view].rgb[0, 0, 2]) - 20) / 10) for f in frames]


def stamps(frames: list[MultiViewFrame], view: int = 0) -> list[float]:
    return [frame.images[view].stamp for frame in frames]


def flat(*, depth: float = 0.6, label: int = 3) -> MultiViewFrame:
    """A frame of one grey plane that belongs to the mug."""
    like = make_frame(0, names=("left",), labelled=True)
    plane = RgbdImage(
        np.full((HEIGHT, WIDTH, 3), 100, np.uint8),
        np.full((HEIGHT, WIDTH), depth, np.float32),
        0.0,
        np.full((HEIGHT, WIDTH), label, np.int16),
    )
    return MultiViewFrame(like.cameras, (plane,), like.label_ids)


def inject_flat(fault: Fault, depth: float = 0.6) -> RgbdImage:
    return FaultInjector([fault], object_label="mug").apply(flat(depth=depth)).images[0]


def test_dropped_frames_keep_the_last_image_and_its_stamp() -> None:
    frames = inject(DroppedFrames(camera="left", start=0.25, duration=0.125))

    assert shown(frames) == [0, 1, 1, 3]
    assert stamps(frames) == [0.0, 0.125, 0.125, 0.375]
    assert shown(frames, view=1) == [0, 1, 2, 3]


def test_frozen_frames_repeat_an_image_with_new_stamps() -> None:
    frames = inject(FrozenFrames(camera="left", start=0.125, duration=0.25))

    assert shown(frames) == [0, 0, 0, 3]
    assert stamps(frames) == [0.0, 0.125, 0.25, 0.375]


def test_delayed_frames_are_older_than_their_stamps() -> None:
    frames = inject(DelayedFrames(camera="left", delay=0.25), frames=5)

    assert shown(frames) == [0, 0, 0, 1, 2]
    assert stamps(frames) == [0.0, 0.125, 0.25, 0.375, 0.5]


def test_swapped_cameras_deliver_each_others_images() -> None:
    left, right = image(1, stamp=0.0), image(2, stamp=0.0)
    frame = MultiViewFrame(make_frame(0).cameras, (left, right))

    dut = FaultInjector([SwappedFrames(cameras=("left", "right"))]).apply(frame)

    assert shown([dut]) == [2]
    assert shown([dut], view=1) == [1]


def test_faults_of_all_cameras_need_no_name() -> None:
    frames = inject(FrozenFrames(start=0.125))

    assert shown(frames) == shown(frames, view=1) == [0, 0, 0, 0]


def test_a_board_hides_what_is_behind_it_in_colour_depth_and_label() -> None:
    board = Occluder(center=(0.25, 0.5), size=(0.5, 1.0), distance=0.3)

    dut = inject_flat(board)

    assert (dut.depth[:, : WIDTH // 2] == np.float32(0.3)).all()
    assert (dut.depth[:, WIDTH // 2 :] == np.float32(0.6)).all()
    assert dut.label is not None
    assert np.unique(dut.label).tolist() == [3, EMPTY_LABEL]
    assert (dut.rgb[:, WIDTH // 2 :] == 100).all()
    assert not (dut.rgb[:, : WIDTH // 2] == 100).any()


def test_a_board_does_not_hide_what_is_nearer() -> None:
    dut = inject_flat(Occluder(distance=0.7), depth=0.6)

    assert (dut.rgb == 100).all()
    assert (dut.depth == np.float32(0.6)).all()


def test_a_hand_hides_the_middle_but_not_the_corners() -> None:
    dut = inject_flat(Occluder(shape="hand", distance=0.3))

    assert dut.depth[HEIGHT // 2 + 3, WIDTH // 2] == np.float32(0.3)
    assert (dut.depth[[0, 0, -1, -1], [0, -1, 0, -1]] == np.float32(0.6)).all()


def test_depth_has_a_scale_and_a_bias_where_it_is_valid() -> None:
    frame = inject(DepthError(scale=1.1, bias=-0.02), frames=1)[0]
    true = make_frame(0).images[0].depth

    assert frame.images[0].depth[10, 10] == pytest.approx(1.1 * true[10, 10] - 0.02, abs=1e-6)
    assert frame.images[0].depth[0, 0] == true[0, 0] == 0.0


def test_depth_holes_cover_their_share() -> None:
    dut = inject_flat(DepthHoles(share=0.25, radius=4))

    assert np.mean(dut.depth == 0.0) == pytest.approx(0.25, abs=1.5 / dut.depth.size)


def test_holes_differ_from_frame_to_frame_but_not_from_run_to_run() -> None:
    first, second = inject(DepthHoles(share=0.5), frames=2)
    (again,) = inject(DepthHoles(share=0.5), frames=1)

    assert np.array_equal(first.images[0].depth, again.images[0].depth)
    holes = [frame.images[0].depth == 0.0 for frame in (first, second)]
    assert not np.array_equal(*holes)


def test_light_scales_each_colour_and_saturates() -> None:
    dut = inject_flat(LightChange(gain=(0.5, 1.0, 3.0)))

    assert dut.rgb[5, 5].tolist() == [50, 100, 255]


def test_wrong_extrinsics_move_the_calibrated_camera_along_its_own_axes() -> None:
    error = ExtrinsicsError(camera="left", translation=(0.01, 0.02, 0.03), rpy=(0.0, 0.0, 90.0))

    (frame,) = inject(error, frames=1)

    # The true camera looks straight down: its y and z axes are the world's, reversed.
    true = make_frame(0).cameras[0].X_WC[:3, 3]
    wrong = frame.cameras[0].X_WC
    np.testing.assert_allclose(wrong[:3, 3] - true, [0.01, -0.02, -0.03], atol=1e-12)
    # Turned by 90 deg about the optical axis: x becomes the camera's y, which is the world's -y.
    np.testing.assert_allclose(wrong[:3, 0], [0.0, -1.0, 0.0], atol=1e-12)
    assert frame.cameras[1] == make_frame(0).cameras[1]


def test_an_untextured_object_loses_its_pattern_and_nothing_else_does() -> None:
    frame = flat()
    v, u = np.indices((HEIGHT, WIDTH))
    board = np.where((u + v) % 2, 60, 140).astype(np.uint8)[..., None].repeat(3, axis=2)
    label = np.where(u < 16, 3, 9).astype(np.int16)
    textured = RgbdImage(board, frame.images[0].depth, 0.0, label)

    dut = FaultInjector([UntexturedObject()], object_label="mug").apply(
        MultiViewFrame(frame.cameras, (textured,), frame.label_ids)
    )

    # The mean of the pattern's two greys.
    assert np.abs(dut.images[0].rgb[:, :16].astype(int) - 100).max() <= 2
    assert np.array_equal(dut.images[0].rgb[:, 16:], board[:, 16:])


def test_a_highlight_is_where_the_surface_mirrors_the_lamp() -> None:
    dut = inject_flat(GlossyObject(lamp=(0.3, -0.2, 1.0), shininess=15.0))

    # The plane faces the camera, which looks down; the lamp is towards (0.3, -0.2, 1) in the
    # world, so towards (0.3, 0.2, -1) in the camera's frame. The ray along (0.3, 0.2, 1) is
    # mirrored to it: u = 15.5 + 30 * 0.3, v = 11.5 + 31 * 0.2.
    rows, columns = np.nonzero(dut.rgb[..., 0] == dut.rgb[..., 0].max())
    assert np.mean(columns) == pytest.approx(24.5, abs=1.0)
    assert np.mean(rows) == pytest.approx(17.7, abs=1.0)
    assert dut.rgb.max() >= 250
    assert dut.depth[18, 24] == 0.0


def test_a_transparent_object_has_holes_and_its_surroundings_do_not() -> None:
    frame = make_frame(0, labelled=True)
    (dut,) = inject(TransparentObject(share=1.0), frames=1, labelled=True)

    label = frame.images[0].label
    assert label is not None
    mug = np.isin(label, (3, 4))
    assert (dut.images[0].depth[mug] == 0.0).all()
    assert np.array_equal(dut.images[0].depth[~mug], frame.images[0].depth[~mug])


def test_a_fault_of_the_object_needs_labels() -> None:
    with pytest.raises(InvalidValueError, match="which pixels show the object"):
        inject(UntexturedObject())


def test_an_unknown_camera_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="DroppedFrames names the camera 'top'") as error:
        inject(DroppedFrames(camera="top"))

    assert "left, right" in error.value.remedy


@pytest.mark.parametrize(
    "fault",
    [
        lambda: DroppedFrames(duration=0.0),
        lambda: DelayedFrames(delay=-1.0),
        lambda: DepthHoles(share=1.5),
        lambda: Occluder(shape="cat"),
    ],
)
def test_a_meaningless_value_is_refused(fault: type) -> None:
    with pytest.raises(InvalidValueError):
        fault()


@pytest.mark.parametrize("fault", [UntexturedObject(), GlossyObject(), TransparentObject()])
@pytest.mark.parametrize("pixels", [0, 1])
def test_an_object_of_hardly_any_pixels_is_no_problem(fault: Fault, pixels: int) -> None:
    frame = flat(label=9)
    image = frame.images[0]
    label = np.full((HEIGHT, WIDTH), 9, np.int16)
    label[-1, WIDTH - pixels :] = 3
    tiny = MultiViewFrame(
        frame.cameras, (RgbdImage(image.rgb, image.depth, 0.0, label),), frame.label_ids
    )

    dut = FaultInjector([fault], object_label="mug").apply(tiny).images[0]

    assert np.array_equal(dut.rgb[:-1], image.rgb[:-1])
    assert np.array_equal(dut.depth[:-1], image.depth[:-1])

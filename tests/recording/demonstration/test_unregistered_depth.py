"""Depth with its own pose and intrinsics."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from small_frames import HEIGHT, WIDTH, K

from poil_drake.errors import DemonstrationError

K_DEPTH = np.array([[60.0, 0.0, 49.5], [0.0, 60.0, 29.5], [0.0, 0.0, 1.0]])
SIZE_DEPTH = (60, 100)
BESIDE = 0.1  # [m], the depth camera stands this far along +x of the colour camera


def beside(foreign, *, frame="left_depth", calibrated=True, connected=True, K_own=K_DEPTH):
    """Makes the left camera's depth that of a camera beside it, and returns what to log more.

    It sees a card, 0.4 m away and reaching from x = 0.05 m of the colour camera to the right, in
    front of a wall 0.5 m away.
    """
    u = np.arange(SIZE_DEPTH[1])
    card = (u - 49.5) / 60.0 * 0.4 + BESIDE > 0.05
    depth = np.tile(np.where(card, 400, 500).astype("<u2"), (SIZE_DEPTH[0], 1))
    registered = foreign.depth

    def left_depth(i, time, lens):
        if lens != "left_lens":
            return registered(i, time, lens)
        return foreign.raw("16UC1", depth, time, frame)

    foreign.depth = left_depth
    if connected:
        transform = foreign.transform("left_lens", frame, (BESIDE, 0.0, 0.0))
        transform.rotation.x, transform.rotation.w = 0.0, 1.0
        foreign.transforms.append(transform)

    def extra(writer):
        message = CameraCalibration(
            frame_id=frame, width=SIZE_DEPTH[1], height=SIZE_DEPTH[0], K=K_own.ravel()
        )
        if calibrated:
            topic = "/camera/left/depth_calibration"
            writer.write_message(topic, message, log_time=0, publish_time=0)

    return extra


def test_depth_with_its_own_calibration_is_registered_to_colour(foreign):
    dut = foreign.load(beside(foreign)).frames[2].images

    assert dut[0].depth.shape == (HEIGHT, WIDTH)
    x = (np.arange(WIDTH) - K[0, 2]) / K[0, 0] * 0.4
    # A pixel of the depth camera is 7 mm wide at the card.
    np.testing.assert_allclose(dut[0].depth[:, x > 0.06], 0.4, rtol=1e-6)
    np.testing.assert_allclose(dut[0].depth[:, (x > -0.15) & (x < 0.01)], 0.5, rtol=1e-6)
    wanted = foreign.image(2, stamp=0.0).depth
    assert np.abs(dut[1].depth - wanted).max() <= 0.5e-3 + 1e-6


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"calibrated": False}, ["'left_depth'", "'left_lens'", "/camera/left/depth_calibration"]),
        ({"connected": False}, ["no transform connects", "'left_depth'", "'left_lens'", "static"]),
        ({"K_own": 0.0 * K_DEPTH}, ["/camera/left/depth_calibration", "calibration is invalid"]),
        (
            {"calibrated": False, "connected": False, "frame": "left_lens"},
            ["/camera/left/depth", "100 x 60", "32 x 24", "depth_calibration"],
        ),
    ],
)
def test_what_is_missing_for_registration_is_named(foreign, options, words):
    with pytest.raises(DemonstrationError) as caught:
        foreign.load(beside(foreign, **options))

    for word in (str(foreign.path), *words):
        assert word in str(caught.value)


@pytest.mark.parametrize("frame", ["left_aligned_depth_to_color_frame", "same_place"])
def test_depth_that_is_registered_may_name_another_frame(foreign, frame):
    registered = foreign.depth
    foreign.depth = lambda i, time, lens: registered(i, time, lens.replace("left_lens", frame))
    if frame == "same_place":
        transform = foreign.transform("left_lens", frame, (0.0, 0.0, 0.0))
        transform.rotation.x, transform.rotation.w = 0.0, 1.0
        foreign.transforms.append(transform)

    depth = foreign.load().frames[1].images[0].depth

    assert np.abs(depth - foreign.image(1, stamp=0.0).depth).max() <= 0.5e-3 + 1e-6

from pathlib import Path

import cv2
import numpy as np
import pytest
from capture_bench import SettableClock

from poil_drake.errors import (
    CaptureError,
    InvalidValueError,
    NoImageError,
    NoMoreImagesError,
)
from poil_drake.perception.capture.config import OpenCvStreams
from poil_drake.perception.capture.opencv_streams import OpenCvStreamsDevice
from poil_drake.perception.images import CameraModel

SIZE = (24, 32)
CAMERA = CameraModel("left", 32, 24, np.eye(3), np.eye(4))
COLORS = [np.random.default_rng(k).integers(0, 256, (*SIZE, 3), np.uint8) for k in range(2)]
# Up to 46 081: 16 bits, with low bits that matter.
STEPS = [np.arange(24 * 32, dtype=np.uint16).reshape(SIZE) * 60 + k for k in range(2)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"rgb_{k:04d}.png"), COLORS[k][..., ::-1])
        cv2.imwrite(str(tmp_path / f"depth_{k:04d}.png"), STEPS[k])
    return tmp_path


def opened(
    folder: Path, clock: SettableClock, *, rgb: str = "rgb", depth: str = "depth"
) -> OpenCvStreamsDevice:
    config = OpenCvStreams(
        rgb=str(folder / f"{rgb}_%04d.png"),
        depth=str(folder / f"{depth}_%04d.png"),
        latency=0.25,
        fps=10.0,
    )
    device = OpenCvStreamsDevice(config, camera=CAMERA, clock=clock)
    device.open()
    return device


@pytest.fixture
def dut(folder: Path, clock: SettableClock) -> OpenCvStreamsDevice:
    return opened(folder, clock)


def test_colour_is_rgb_and_depth_keeps_16_bits(
    dut: OpenCvStreamsDevice, clock: SettableClock
) -> None:
    for k in range(2):
        image = dut.read()
        assert image is not None
        np.testing.assert_array_equal(image.rgb, COLORS[k])
        np.testing.assert_allclose(image.depth, STEPS[k] / 1000.0, rtol=1e-6)
        assert image.stamp == clock.now - 0.25
        clock.now += 0.125


def test_files_are_read_at_their_rate_to_their_end(
    dut: OpenCvStreamsDevice, clock: SettableClock
) -> None:
    assert dut.read() is not None
    assert dut.read() is None
    clock.now += 0.125
    assert dut.read() is not None
    clock.now += 0.125

    for _ in range(2):
        with pytest.raises(NoMoreImagesError, match=r"'left'.*no more images"):
            dut.read()


@pytest.mark.parametrize(
    ("sources", "problem"),
    [({"depth": "rgb"}, "depth of shape"), ({"rgb": "depth"}, "colour of shape")],
)
def test_images_of_the_wrong_kind_are_rejected(
    folder: Path, clock: SettableClock, sources: dict[str, str], problem: str
) -> None:
    dut = opened(folder, clock, **sources)

    with pytest.raises(NoImageError, match=f"'left' delivers {problem}"):
        dut.read()


def test_an_error_names_a_source_that_does_not_open(folder: Path, clock: SettableClock) -> None:
    with pytest.raises(CaptureError, match=r"nothing_%04d\.png"):
        opened(folder, clock, depth="nothing")


@pytest.mark.parametrize("missing", ["rgb", "depth"])
def test_both_sources_are_required(missing: str) -> None:
    config = OpenCvStreams(**{"rgb": "0", "depth": "1", missing: ""})  # type: ignore[arg-type]

    with pytest.raises(InvalidValueError, match=f"OpenCvStreams.{missing}"):
        OpenCvStreamsDevice(config, camera=CAMERA, clock=SettableClock())


def test_a_file_and_a_live_source_are_not_a_pair() -> None:
    config = OpenCvStreams(rgb="0", depth="depth_%04d.png")

    with pytest.raises(InvalidValueError, match=r"'left'.*rgb '0', depth 'depth_%04d\.png'"):
        OpenCvStreamsDevice(config, camera=CAMERA, clock=SettableClock())

import subprocess
import sys

import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.perception.capture.config import McapPlayback, OpenCvStreams, RealSense, Zed


@pytest.mark.parametrize("kind", [RealSense, Zed, OpenCvStreams, McapPlayback])
def test_all_fields_have_defaults(kind: type) -> None:
    assert kind() == kind()


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (RealSense, "fps", 0),
        (RealSense, "depth_width", -1),
        (RealSense, "latency", -0.1),
        (RealSense, "silence", float("nan")),
        (Zed, "serial", -1),
        (Zed, "fps", -30),
        (Zed, "latency", float("inf")),
        (RealSense, "settle", -1.0),
        (Zed, "settle", float("nan")),
        (OpenCvStreams, "settle", -1.0),
        (OpenCvStreams, "silence", 0.0),
        (OpenCvStreams, "largest_gap", 0.0),
        (OpenCvStreams, "rgb_fourcc", "MJPEG"),
        (OpenCvStreams, "depth_fourcc", "Y16"),
        (OpenCvStreams, "depth_scale", 0.0),
        (OpenCvStreams, "fps", 0.0),
        (OpenCvStreams, "latency", -1.0),
        (McapPlayback, "rate", 0.0),
        (McapPlayback, "rate", float("inf")),
        (McapPlayback, "lead_in", -1.0),
    ],
)
def test_an_error_names_an_invalid_value(kind: type, field: str, value: object) -> None:
    with pytest.raises(InvalidValueError, match=rf"{kind.__name__}\.{field} is '?{value}'?\."):
        kind(**{field: value})


def test_no_camera_library_is_loaded() -> None:
    code = (
        "import sys, poil_drake.perception.capture.config, poil_drake.perception.capture.registry\n"
        "print(*({'pyrealsense2', 'pyzed', 'cv2', 'mcap'} & sys.modules.keys()))"
    )

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert done.stdout.strip() == ""

import subprocess
import sys

import pytest
from capture_bench import CAMERA, SettableClock

from poil_drake.errors import InvalidValueError, MissingDependencyError
from poil_drake.perception.capture.config import McapPlayback, OpenCvStreams, RealSense, Zed
from poil_drake.perception.capture.device import make_device

NAN, INFINITY = float("nan"), float("inf")
INVALID: dict[type, dict[str, object]] = {
    RealSense: {"fps": 0, "depth_width": -1, "latency": -0.1, "silence": NAN, "settle": -1.0},
    Zed: {"serial": -1, "fps": -30, "latency": INFINITY, "settle": NAN},
    OpenCvStreams: {
        **{"settle": -1.0, "silence": 0.0, "largest_gap": 0.0, "latency": -1.0},
        **{"rgb_fourcc": "MJPEG", "depth_fourcc": "Y16", "depth_scale": 0.0, "fps": 0.0},
    },
    McapPlayback: {"rate": INFINITY, "lead_in": -1.0},
}


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [(kind, *item) for kind, invalid in INVALID.items() for item in invalid.items()],
)
def test_an_error_names_an_invalid_value(kind: type, field: str, value: object) -> None:
    with pytest.raises(InvalidValueError, match=rf"{kind.__name__}\.{field} is '?{value}'?\."):
        kind(**{field: value})


def test_no_camera_library_is_loaded() -> None:
    code = (
        "import sys, poil_drake.perception.capture.config, poil_drake.perception.capture.device\n"
        "print(*({'pyrealsense2', 'pyzed', 'cv2', 'mcap'} & sys.modules.keys()))"
    )

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert done.stdout.strip() == ""


@pytest.mark.parametrize(
    ("config", "module", "remedy"),
    [
        (RealSense(), "pyrealsense2", "pip install"),
        (Zed(), "pyzed.sl", "ZED SDK"),
        (Zed(), "pyzed", "ZED SDK"),
    ],
)
def test_an_error_names_a_missing_library_before_anything_is_opened(
    monkeypatch: pytest.MonkeyPatch, config: RealSense | Zed, module: str, remedy: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)

    with pytest.raises(MissingDependencyError, match=f"{module.split('.')[0]}.*{remedy}"):
        make_device(config, camera=CAMERA, clock=SettableClock())

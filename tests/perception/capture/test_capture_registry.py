import sys

import pytest
from capture_bench import CAMERA, SettableClock

from poil_drake.errors import InvalidValueError, MissingDependencyError
from poil_drake.perception.capture.config import OpenCvStreams, RealSense, Zed
from poil_drake.perception.capture.registry import make_device


def test_the_configuration_selects_the_device() -> None:
    config = OpenCvStreams(rgb="0", depth="1")

    device = make_device(config, camera=CAMERA, clock=SettableClock())

    assert type(device).__name__ == "OpenCvStreamsDevice"


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


def test_an_unknown_configuration_is_rejected() -> None:
    with pytest.raises(InvalidValueError, match=r"'left'.*object"):
        make_device(object(), camera=CAMERA, clock=SettableClock())  # type: ignore[arg-type]

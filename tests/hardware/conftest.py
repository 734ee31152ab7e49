"""What the tests with a stand-in robot share."""

from pathlib import Path

import numpy as np
import pytest

from poil_drake.diagrams.scenario import Scenario
from poil_drake.diagrams.station import CaptureFrame, MakeStation

_HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if _HERE in item.path.parents:
            item.add_marker(pytest.mark.real_time)


@pytest.fixture(scope="session")
def pictures(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the cameras of the package's own scenario show at the start, with labels."""
    station = MakeStation(scenario, ignore_output_delay=True)
    frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)
    path = tmp_path_factory.mktemp("pictures") / "pictures.npz"
    arrays = {
        f"{camera.name}.{kind}": getattr(image, kind)
        for camera, image in zip(frame.cameras, frame.images, strict=True)
        for kind in ("rgb", "depth", "label")
    }
    np.savez(path, **arrays)
    return path

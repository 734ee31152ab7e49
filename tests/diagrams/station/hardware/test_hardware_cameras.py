"""The cameras of the hardware station, without a robot and without their threads."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.station.hardware import hardware_station
from poil_drake.diagrams.station.station import MakeStation, RequireLabels, Station
from poil_drake.errors import ScenarioError
from poil_drake.perception.images import RgbdImage

_NETWORKS = "lcm_buses: {robot: {lcm_url: 'memq://'}, images: {lcm_url: 'memq://'}}"


@pytest.fixture(autouse=True)
def threads(monkeypatch: pytest.MonkeyPatch) -> dict[str, SimpleNamespace]:
    """Fake capture threads by camera, whose attributes the tests set."""
    made: dict[str, SimpleNamespace] = {}

    def make(device: object, *, name: str, **options: object) -> SimpleNamespace:
        return made.setdefault(name, SimpleNamespace(newest=None, problem=""))

    monkeypatch.setattr(hardware_station, "CaptureThread", make)
    return made


def make_station(cameras: str = "", *, detector: str = "label_image") -> Station:
    text = f"{{{_NETWORKS}, poil: {{hardware: {{cameras: {{{cameras}}}}}}}}}"
    return MakeStation(ChooseScenario(data=text, detector=detector), hardware=True)


def image(age: float) -> RgbdImage:
    rgb, depth = np.zeros((4, 6, 3), np.uint8), np.ones((4, 6), np.float32)
    return RgbdImage(rgb, depth, time.time() - age)


def test_a_stopped_camera_is_reported_with_its_age_and_cause(
    threads: dict[str, SimpleNamespace],
) -> None:
    dut = make_station()
    limit = dut.scenario.poil.safety.image_age_limit
    threads["left"].newest, threads["left"].problem = image(limit + 100.0), "It is unplugged"
    threads["right"].newest = image(0.0)

    assert dut.Problems() == (
        "camera 'left': It is unplugged",
        f"camera 'left': no new image for {limit + 100.0:.1f} s",
    )


def test_a_camera_without_any_image_yet_is_no_problem() -> None:
    assert make_station().Problems() == ()


def test_a_camera_whose_clock_is_ahead_is_named(threads: dict[str, SimpleNamespace]) -> None:
    dut = make_station()
    threads["right"].newest = image(-100.0)

    (problem,) = dut.Problems()

    assert problem.startswith("camera 'right': its images are stamped")
    assert problem.endswith("s in the future: are the clocks synchronized?")


def test_a_recording_with_labels_is_accepted() -> None:
    dut = make_station(f"left: !McapPlayback {{file: {__file__}}}, right: !LcmImages {{}}")

    RequireLabels(dut)

    assert dut.HasOutputPort("left.label_image")


@pytest.mark.parametrize(
    "source",
    [
        "!LcmImages {labels: false}",
        f"!McapPlayback {{file: {__file__}, labels: false}}",
        "!OpenCvStreams {rgb: '0', depth: '1'}",
    ],
)
def test_cameras_without_labels_are_refused(source: str) -> None:
    dut = make_station(f"left: {source}, right: {source}")

    with pytest.raises(ScenarioError, match=r"cameras left, right provides.*!LcmImages.*!Mcap"):
        RequireLabels(dut)


def test_a_detector_that_reads_no_labels_needs_none() -> None:
    source = "!LcmImages {labels: false}"

    RequireLabels(make_station(f"left: {source}, right: {source}", detector="demonstration"))


def test_labels_of_one_camera_are_enough() -> None:
    dut = make_station("right: !LcmImages {labels: false}")

    RequireLabels(dut)

    assert dut.HasOutputPort("left.label_image")
    assert not dut.HasOutputPort("right.label_image")

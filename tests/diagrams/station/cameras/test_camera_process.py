"""Images that a separate process renders."""

import copy
import os
import signal
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mjcf_kitchen import write_kitchen
from pydrake.math import RigidTransform
from station_state import SetObjectPose

from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.camera_process import CameraProcess
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import PoilError, StationError
from poil_drake.perception.images import RgbdImage

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def drawn() -> Scenario:
    """A scenario with choices that are in no file: a mug and its pose, drawn with a seed."""
    return ChooseScenario(seed=5)


def require_equal(images: Sequence[RgbdImage], expected: Sequence[RgbdImage]) -> None:
    for image, wanted in zip(images, expected, strict=True):
        for name in ("rgb", "depth", "label"):
            np.testing.assert_array_equal(getattr(image, name), getattr(wanted, name))


@pytest.mark.parametrize("models", ["the package's", "the user's"])
def test_the_first_pictures_are_those_of_the_station_itself_to_the_last_bit(
    models: str, drawn: Scenario, tmp_path: Path
) -> None:
    own = models == "the user's"
    scenario = LoadScenario(filename=write_kitchen(tmp_path)) if own else drawn
    station = MakeStation(scenario, ignore_output_delay=True)
    context = station.CreateDefaultContext()
    SetObjectPose(station, context, RigidTransform([0.45, -0.1, 0.15]))
    context.SetTime(0.375)
    plant = station.plant()
    positions = plant.GetPositions(station.GetSubsystemContext(plant, context))
    with closing(CameraProcess(scenario)) as dut:
        images, labels = dut.render(positions, 0.375), dut.render_labels(positions, 0.375)

    expected = CaptureFrame(station, context, labels=True).images
    names = station.camera_names
    require_equal([replace(images[n], label=labels[n]) for n in names], expected)
    assert [images[name].stamp for name in names] == [0.375, 0.375]


def with_three_cameras(scenario: Scenario) -> Scenario:
    """Returns the scenario with three cameras whose names are not in alphabetical order."""
    cameras = {name: scenario.cameras[name] for name in ("right", "left")}
    top = copy.copy(scenario.cameras["left"])
    top.name, top.X_PB = "above", scenario.cameras["right"].X_PB
    poil = replace(scenario.poil, parts={"handle": "handle", "bowl": "body"})
    return replace(scenario, cameras={**cameras, "above": top}, poil=poil)


def test_a_station_whose_cameras_delay_takes_the_same_pictures(drawn: Scenario) -> None:
    scenario = with_three_cameras(drawn)
    delayed = MakeStation(scenario)
    prompt = MakeStation(scenario, ignore_output_delay=True)

    frames = [
        CaptureFrame(station, station.CreateDefaultContext(), labels=True)
        for station in (delayed, prompt)
    ]
    delayed.Close()

    offsets = [station.tracker_timing.offset for station in (delayed, prompt)]
    assert offsets == [7 / 64 + 1 / 256, 0.0]
    assert frames[0].label_ids == frames[1].label_ids
    require_equal(frames[0].images, frames[1].images)
    for a, b in zip(*(frame.cameras for frame in frames), strict=True):
        np.testing.assert_array_equal(a.X_WC, b.X_WC)
        np.testing.assert_array_equal(a.K, b.K)


def test_no_process_starts_before_the_first_picture(drawn: Scenario) -> None:
    assert CameraProcess(drawn).pid is None


def test_a_process_that_has_died_is_named_with_a_remedy(drawn: Scenario) -> None:
    with closing(CameraProcess(drawn)) as dut:
        dut.start()
        os.kill(dut.pid, signal.SIGKILL)

        with pytest.raises(StationError, match="cameras' process has ended with status -9") as info:
            dut.warm_up()

    assert "output_delay 0" in info.value.remedy


def test_a_scenario_that_cannot_be_built_is_reported() -> None:
    with (
        closing(CameraProcess(ChooseScenario(data="{poil: {robot: arm}}"))) as dut,
        pytest.raises(PoilError, match="arm"),
    ):
        dut.warm_up()


def test_after_closing_there_are_no_pictures(drawn: Scenario) -> None:
    dut = CameraProcess(drawn)
    dut.start()
    pid = dut.pid
    dut.close()

    assert dut.pid is None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    with pytest.raises(StationError, match="has been closed"):
        dut.render(np.zeros(1), 0.0)

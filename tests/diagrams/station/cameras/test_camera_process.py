"""Pictures taken in a process of its own."""

import dataclasses
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mjcf_kitchen import write_kitchen
from pydrake.math import RigidTransform
from station_state import SetObjectPose

from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario, default_scenario_file
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.camera_process import CameraProcess
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import PoilError, StationError

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def drawn() -> Scenario:
    """A scenario with choices that no file has: a mug and its pose, drawn by a seed."""
    return ChooseScenario(seed=5)


@pytest.fixture(scope="module")
def dut(drawn: Scenario) -> Iterator[CameraProcess]:
    process = CameraProcess(drawn)
    yield process
    process.close()


def test_pictures_are_those_of_the_station_itself_to_the_last_bit(
    dut: CameraProcess, drawn: Scenario
) -> None:
    check_pictures(dut, drawn)


def test_models_of_a_users_own_are_drawn_as_well(tmp_path: Path) -> None:
    kitchen = LoadScenario(filename=write_kitchen(tmp_path))
    dut = CameraProcess(kitchen)
    try:
        check_pictures(dut, kitchen)
    finally:
        dut.close()


def check_pictures(dut: CameraProcess, scenario: Scenario) -> None:
    """Compares pictures at two times, with the object at two places, with the station's."""
    station = MakeStation(scenario, ignore_output_delay=True)
    context = station.CreateDefaultContext()
    for time, x in ((0.375, 0.45), (1.0, 0.5)):
        SetObjectPose(station, context, RigidTransform([x, -0.1, 0.15]))
        context.SetTime(time)
        positions = station.plant().GetPositions(
            station.GetSubsystemContext(station.plant(), context)
        )

        images, labels = dut.render(positions, time), dut.render_labels(positions, time)

        expected = CaptureFrame(station, context, labels=True).images
        assert len(images) == len(labels) == len(expected) == 2
        for image, label, wanted in zip(images, labels, expected, strict=True):
            np.testing.assert_array_equal(image.rgb, wanted.rgb)
            np.testing.assert_array_equal(image.depth, wanted.depth)
            np.testing.assert_array_equal(label, wanted.label)
            assert image.stamp == time


def test_a_station_whose_cameras_delay_takes_the_same_pictures(drawn: Scenario) -> None:
    delayed = MakeStation(drawn)
    prompt = MakeStation(drawn, ignore_output_delay=True)

    frames = [
        CaptureFrame(station, station.CreateDefaultContext(), labels=True)
        for station in (delayed, prompt)
    ]
    delayed.Close()

    offsets = [station.tracker_timing.offset for station in (delayed, prompt)]
    assert offsets == [3 / 32 + 1 / 256, 0.0]
    assert frames[0].label_ids == frames[1].label_ids
    for a, b in zip(*(frame.images for frame in frames), strict=True):
        np.testing.assert_array_equal(a.rgb, b.rgb)
        np.testing.assert_array_equal(a.depth, b.depth)
        np.testing.assert_array_equal(a.label, b.label)
    for a, b in zip(*(frame.cameras for frame in frames), strict=True):
        np.testing.assert_array_equal(a.X_WC, b.X_WC)
        np.testing.assert_array_equal(a.K, b.K)


def test_nothing_is_started_before_a_picture_is_wanted(drawn: Scenario) -> None:
    assert CameraProcess(drawn).pid is None


def test_a_process_that_has_died_is_named_with_a_remedy(drawn: Scenario) -> None:
    dut = CameraProcess(drawn)
    dut.start()
    os.kill(dut.pid, signal.SIGKILL)

    with pytest.raises(StationError, match=r"cameras' process has ended with status -9") as info:
        dut.warm_up()

    assert "output_delay 0" in info.value.remedy
    dut.close()


def test_what_the_process_cannot_build_is_named() -> None:
    scenario = LoadScenario(filename=default_scenario_file())
    nowhere = dataclasses.replace(scenario, poil=dataclasses.replace(scenario.poil, robot="arm"))
    dut = CameraProcess(nowhere)

    with pytest.raises(PoilError, match="arm"):
        dut.warm_up()

    dut.close()


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

"""The real robot's station against a stand-in robot in another process."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hardware_bench import HOME, hardware_scenario, stand_in
from machine_pace import SLOWEST

from poil_drake.diagrams.scenario.hardware_config import LcmImages
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import (
    CaptureFrame,
    HardwareStation,
    MakeStation,
    RequireLabels,
)
from poil_drake.errors import ScenarioError, StationError

pytestmark = pytest.mark.render


@pytest.fixture
def robot_scenario(scenario: Scenario, pictures: Path, tmp_path: Path) -> Iterator[Scenario]:
    """A scenario whose stand-in robot is running."""
    scenario = hardware_scenario(scenario, time_scale=SLOWEST)
    with stand_in(scenario, pictures, tmp_path):
        yield scenario


def test_images_and_arm_state_are_the_robots(robot_scenario: Scenario, pictures: Path) -> None:
    with MakeStation(robot_scenario, hardware=True) as dut:
        context = dut.CreateDefaultContext()
        frame = CaptureFrame(dut, context, labels=True)
        position, problems = dut.ArmPosition(context), dut.Problems()

    truth = np.load(pictures)
    np.testing.assert_array_equal(position, HOME)
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        np.testing.assert_array_equal(image.rgb, truth[f"{camera.name}.rgb"])
        np.testing.assert_array_equal(image.depth, truth[f"{camera.name}.depth"])
        np.testing.assert_array_equal(image.label, truth[f"{camera.name}.label"])
    assert {"mug", "mug/handle", "rack"} <= frame.label_ids.keys()
    assert problems == ()


def test_cameras_have_the_same_models_as_in_simulation(robot_scenario: Scenario) -> None:
    hardware = MakeStation(robot_scenario, hardware=True)
    simulated = MakeStation(robot_scenario, ignore_output_delay=True)

    for real, rendered in zip(hardware.camera_models, simulated.camera_models, strict=True):
        np.testing.assert_array_equal(real.X_WC, rendered.X_WC)
        np.testing.assert_array_equal(real.K, rendered.K)
    assert hardware.label_ids == simulated.label_ids
    assert hardware.robot_base_pose().IsExactlyEqualTo(simulated.robot_base_pose())


def waiting(scenario: Scenario, seconds: float) -> Scenario:
    hardware = dataclasses.replace(scenario.poil.hardware, ready_timeout=seconds)
    return dataclasses.replace(scenario, poil=dataclasses.replace(scenario.poil, hardware=hardware))


def test_everything_that_is_missing_is_named(scenario: Scenario) -> None:
    dut = MakeStation(waiting(hardware_scenario(scenario), 0.1), hardware=True)

    with pytest.raises(StationError) as error, dut:
        pass

    for missing in ("the robot's status", "the hand's status", "'left'", "'right'"):
        assert missing in str(error.value)


def test_a_detector_that_reads_labels_refuses_a_camera_without_labels(
    scenario: Scenario,
) -> None:
    hardware = dataclasses.replace(
        scenario.poil.hardware, cameras={"right": LcmImages(labels=False)}
    )
    poil = dataclasses.replace(scenario.poil, hardware=hardware)
    dut = MakeStation(dataclasses.replace(scenario, poil=poil), hardware=True)

    with pytest.raises(ScenarioError, match="camera 'right' does not provide"):
        RequireLabels(dut)
    assert dut.HasOutputPort("left.label_image")
    assert not dut.HasOutputPort("right.label_image")


def test_a_capture_sends_no_commands(scenario: Scenario, pictures: Path, tmp_path: Path) -> None:
    scenario = hardware_scenario(scenario, time_scale=SLOWEST)
    with stand_in(scenario, pictures, tmp_path) as robot:
        with MakeStation(scenario, hardware=True) as dut:
            CaptureFrame(dut, dut.CreateDefaultContext())
        record = robot.finish()

    assert isinstance(dut, HardwareStation)
    assert record["commanded"] == []
    assert record["hand_told"] == []

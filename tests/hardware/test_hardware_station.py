"""The real robot's station against a stand-in robot in another process."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hardware_bench import HOME, StandIn, hardware_scenario, stand_in
from machine_pace import SLOWEST

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import StationError

pytestmark = pytest.mark.render


@pytest.fixture
def robot_scenario(scenario: Scenario) -> Scenario:
    return hardware_scenario(scenario, time_scale=SLOWEST)


@pytest.fixture
def robot(robot_scenario: Scenario, pictures: Path, tmp_path: Path) -> Iterator[StandIn]:
    """The stand-in robot of the scenario."""
    with stand_in(robot_scenario, pictures, tmp_path) as robot:
        yield robot


def test_images_and_arm_state_are_the_robots_and_nothing_is_commanded(
    robot: StandIn, robot_scenario: Scenario, pictures: Path
) -> None:
    with MakeStation(robot_scenario, hardware=True) as dut:
        context = dut.CreateDefaultContext()
        frame = CaptureFrame(dut, context, labels=True)
        position, problems = dut.ArmPosition(context), dut.Problems()
    record = robot.finish()

    truth = np.load(pictures)
    np.testing.assert_array_equal(position, HOME)
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        np.testing.assert_array_equal(image.rgb, truth[f"{camera.name}.rgb"])
        np.testing.assert_array_equal(image.depth, truth[f"{camera.name}.depth"])
        np.testing.assert_array_equal(image.label, truth[f"{camera.name}.label"])
    assert {"mug", "mug/handle", "rack"} <= frame.label_ids.keys()
    assert problems == ()
    assert record["commanded"] == []
    assert record["hand_told"] == []


def test_cameras_have_the_same_models_as_in_simulation(robot_scenario: Scenario) -> None:
    hardware = MakeStation(robot_scenario, hardware=True)
    simulated = MakeStation(robot_scenario, ignore_output_delay=True)

    for real, rendered in zip(hardware.camera_models, simulated.camera_models, strict=True):
        np.testing.assert_array_equal(real.X_WC, rendered.X_WC)
        np.testing.assert_array_equal(real.K, rendered.K)
    assert hardware.label_ids == simulated.label_ids
    assert hardware.robot_base_pose().IsExactlyEqualTo(simulated.robot_base_pose())


def test_everything_that_is_missing_is_named(scenario: Scenario) -> None:
    dut = MakeStation(hardware_scenario(scenario, ready_timeout=0.1), hardware=True)

    with pytest.raises(StationError) as error, dut:
        pass

    for missing in ("the robot's status", "the hand's status", "'left'", "'right'"):
        assert missing in str(error.value)

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from system_bench import SystemBench

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.systems.ik.measured_posture import MeasuredPosture

ARM = np.linspace(-0.3, 0.3, 7)


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    return MakeStation(ChooseScenario(), cameras=False).plant()


@pytest.fixture
def dut(plant: MultibodyPlant) -> MeasuredPosture:
    return MeasuredPosture(plant=plant, robot=plant.GetModelInstanceByName("panda"))


def posture(dut: MeasuredPosture, arm: np.ndarray, width: float) -> np.ndarray:
    return SystemBench(dut, position_measured=arm, width_measured=width).read("positions")


def test_only_the_robot_leaves_its_default(dut: MeasuredPosture, plant: MultibodyPlant) -> None:
    robot, mug = (plant.GetModelInstanceByName(name) for name in ("panda", "mug"))

    positions = posture(dut, ARM, 0.05)

    # Both fingers are half of the opening away from the middle.
    expected = np.r_[ARM, 0.025, 0.025]
    np.testing.assert_allclose(plant.GetPositionsFromArray(robot, positions), expected)
    default = plant.GetPositions(plant.CreateDefaultContext())
    np.testing.assert_array_equal(
        plant.GetPositionsFromArray(mug, positions), plant.GetPositionsFromArray(mug, default)
    )


def test_without_measurements_the_robot_is_at_its_default(
    dut: MeasuredPosture, plant: MultibodyPlant
) -> None:
    default = plant.GetPositions(plant.CreateDefaultContext())

    positions = posture(dut, np.full(7, np.nan), np.nan)

    np.testing.assert_array_equal(positions, default)

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from poil_drake.control.entry_monitor import EntryState, EntryStatus, safe_entry_step
from poil_drake.control.point_trajectory import PointTrajectory
from poil_drake.control.safe_entry import SafeEntryPlanner
from poil_drake.geometry.scene_distance import SceneDistance
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.point_set_bcsdm import PointSetBcsdm, PointSetBcsdmConfig
from poil_drake.systems.safe_entry import SafeEntry
from poil_drake.systems.statuses import ControllerStatus

PERIOD = 1 / 256
BODY = 0.03 * np.array([[1.0, 0, 0], [-1, 0.2, 0], [0, 1.5, 0], [0, -1.5, 0.3], [0, 0, 2]])
GOAL = np.array([0.5, 0.2, 0.2])
BEHIND = BODY + np.array([0.5, -0.2, 0.2])
ASIDE = BEHIND - np.array([0.0, 0.1, 0.0])


@pytest.fixture(scope="module")
def planner() -> SafeEntryPlanner:
    """The body moves along x to its goal; a wall stands between it and y < 0."""
    count = 33
    times = np.arange(count) / 32
    positions = BODY + GOAL + np.linspace(-0.1, 0.0, count)[:, None, None] * [1.0, 0.0, 0.0]
    velocities = np.broadcast_to([0.1, 0.0, 0.0], positions.shape).copy()
    velocities[-1] = 0.0
    x, z = np.meshgrid(np.arange(0.2, 0.8, 0.01), np.arange(0.0, 0.4, 0.01))
    wall = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    return SafeEntryPlanner(
        reference=PointTrajectory(times, positions, velocities),
        scene=SceneDistance(wall),
        object_cloud=BODY,
        object_points=BODY,
    )


class Bench:
    """The dut, the controller after it, and fixed inputs."""

    def __init__(self, planner: SafeEntryPlanner, points: np.ndarray):
        builder = DiagramBuilder()
        self.dut = builder.AddSystem(SafeEntry(planner=planner, period=PERIOD))
        self.controller = builder.AddSystem(
            PointSetBcsdm(
                reference=planner.model.reference,
                period=PERIOD,
                config=PointSetBcsdmConfig(bcsdm=planner.field),
            )
        )
        builder.Connect(
            self.dut.GetOutputPort("reference"), self.controller.GetInputPort("reference")
        )
        for name in ("points", "confidence"):
            builder.ExportInput(self.dut.GetInputPort(name), name)
            builder.ConnectInput(name, self.controller.GetInputPort(name))
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.fix("points", points)
        self.fix("confidence", np.ones(len(BODY)))
        self.controller.GetInputPort("gripper_pose").FixValue(
            self.controller.GetMyMutableContextFromRoot(self.context), np.eye(4).ravel()
        )

    def fix(self, name: str, value: np.ndarray) -> None:
        self.diagram.GetInputPort(name).FixValue(self.context, value.ravel())

    def read(self, name: str):
        return self.dut.GetOutputPort(name).Eval(self.dut.GetMyContextFromRoot(self.context))

    def command(self, name: str) -> np.ndarray:
        context = self.controller.GetMyContextFromRoot(self.context)
        return self.controller.GetOutputPort(name).Eval(context)


def test_before_the_first_points_there_is_nothing_to_follow(planner):
    bench = Bench(planner, np.full(BODY.shape, np.nan))

    bench.simulator.AdvanceTo(PERIOD)

    assert bench.read("reference") is ABSENT
    assert bench.read("status")[0] == EntryStatus.WAITING
    np.testing.assert_array_equal(bench.command("spatial_velocity"), np.zeros(6))


def test_outputs_are_those_of_the_pure_function(planner):
    bench = Bench(planner, BEHIND)

    bench.simulator.AdvanceTo(0.5 * PERIOD)

    expected = safe_entry_step(EntryState(), BEHIND, 0.0, planner)
    np.testing.assert_array_equal(bench.read("reference").positions, expected.reference.positions)
    assert bench.read("status")[0] == EntryStatus.FOLLOWING
    # The controller follows the plan, whose first motion is not the papers' through the wall.
    np.testing.assert_allclose(
        bench.command("target_points"), expected.reference.positions[0].ravel(), atol=1e-6
    )


def test_the_same_reference_is_given_until_there_is_another_plan(planner):
    bench = Bench(planner, BEHIND)
    bench.simulator.AdvanceTo(0.5 * PERIOD)
    first = bench.read("reference")
    bench.simulator.AdvanceTo(20.5 * PERIOD)
    second = bench.read("reference")

    bench.fix("points", ASIDE)
    # One look at the points at least every 1/16 s, and 0.1 s of patience.
    bench.simulator.AdvanceTo(0.1)
    held = bench.read("reference")
    bench.simulator.AdvanceTo(0.4)

    assert second is first
    assert held is ABSENT
    assert bench.read("reference") is not first
    np.testing.assert_allclose(bench.read("reference").positions[0], ASIDE, atol=1e-6)


def test_while_it_holds_the_controller_stands_still(planner):
    bench = Bench(planner, BEHIND)
    bench.simulator.AdvanceTo(0.5 * PERIOD)

    bench.fix("points", ASIDE)
    bench.simulator.AdvanceTo(0.1)

    np.testing.assert_array_equal(bench.command("spatial_velocity"), np.zeros(6))
    assert bench.command("status")[0] == ControllerStatus.INVALID_INPUT


def test_no_input_reaches_an_output_at_once(planner):
    dut = SafeEntry(planner=planner, period=PERIOD)

    assert not dut.HasAnyDirectFeedthrough()

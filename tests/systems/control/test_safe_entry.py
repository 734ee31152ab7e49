import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from system_bench import SystemBench

from poil_drake.control.entry.entry_monitor import safe_entry_step
from poil_drake.control.entry.entry_paths import TransitConfig
from poil_drake.control.entry.entry_state import EntryMonitorConfig, EntryState, EntryStatus
from poil_drake.control.entry.safe_entry import SafeEntryConfig, SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.control.point_set_bcsdm import PointSetBcsdm, PointSetBcsdmConfig
from poil_drake.systems.control.safe_entry import SafeEntry
from poil_drake.systems.statuses import ControllerStatus

PERIOD = 1 / 256
BODY = 0.03 * np.array([[1.0, 0, 0], [-1, 0.2, 0], [0, 1.5, 0], [0, -1.5, 0.3], [0, 0, 2]])
GOAL = np.array([0.5, 0.2, 0.2])
BEHIND = BODY + np.array([0.5, -0.2, 0.2])
ASIDE = BEHIND - np.array([0.0, 0.1, 0.0])


def make_planner(cage: np.ndarray, iterations: int = 400) -> SafeEntryPlanner:
    """The body moves along x to its goal; a wall stands between it and y < 0, and a cage."""
    count = 33
    times = np.arange(count) / 32
    positions = BODY + GOAL + np.linspace(-0.1, 0.0, count)[:, None, None] * [1.0, 0.0, 0.0]
    velocities = np.broadcast_to([0.1, 0.0, 0.0], positions.shape).copy()
    velocities[-1] = 0.0
    x, z = np.meshgrid(np.arange(0.2, 0.8, 0.01), np.arange(0.0, 0.4, 0.01))
    wall = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    return SafeEntryPlanner(
        reference=PointTrajectory(times, positions, velocities),
        scene=SceneCloud(np.concatenate([wall, cage])),
        object_cloud=BODY,
        object_points=BODY,
        config=SafeEntryConfig(transit=TransitConfig(iterations=iterations)),
    )


@pytest.fixture(scope="module")
def planner() -> SafeEntryPlanner:
    return make_planner(np.empty((0, 3)))


@pytest.fixture(scope="module")
def caged_planner() -> SafeEntryPlanner:
    """A cube of 20 cm encloses the body behind the wall."""
    grid = np.linspace(-0.1, 0.1, 21)
    cube = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    faces = cube[np.abs(cube).max(axis=1) > 0.0999]
    return make_planner(faces + BEHIND.mean(axis=0), iterations=20)


def make_bench(
    planner: SafeEntryPlanner,
    points: np.ndarray,
    *,
    config: EntryMonitorConfig | None = None,
    bcsdm: BcsdmConfig | None = None,
) -> SystemBench:
    """The dut and the controller that it steers; the status is that of the dut."""
    builder = DiagramBuilder()
    dut = builder.AddSystem(SafeEntry(planner=planner, period=PERIOD, config=config))
    controller = builder.AddSystem(
        PointSetBcsdm(
            reference=planner.model.reference,
            period=PERIOD,
            config=PointSetBcsdmConfig(bcsdm=bcsdm or planner.field),
        )
    )
    builder.Connect(dut.GetOutputPort("reference"), controller.GetInputPort("reference"))
    for name in ("points", "confidence"):
        builder.ExportInput(dut.GetInputPort(name), name)
        builder.ConnectInput(name, controller.GetInputPort(name))
    builder.ExportInput(controller.GetInputPort("gripper_pose"), "gripper_pose")
    for name in ("reference", "status"):
        builder.ExportOutput(dut.GetOutputPort(name), name)
    for name in ("spatial_velocity", "target_points", "tau"):
        builder.ExportOutput(controller.GetOutputPort(name), name)
    builder.ExportOutput(controller.GetOutputPort("status"), "controller.status")
    return SystemBench(
        builder.Build(), points=points, confidence=np.ones(len(BODY)), gripper_pose=np.eye(4)
    )


@pytest.mark.parametrize("outside", [np.nan, 5.0], ids=["unknown", "outside the workspace"])
def test_before_three_points_are_known_there_is_no_reference(planner, outside):
    few = BEHIND.copy()
    few[2:] += outside
    bench = make_bench(planner, few)

    bench.advance_to(PERIOD)

    assert bench.read("reference") is ABSENT
    assert bench.read("status")[0] == EntryStatus.WAITING
    np.testing.assert_array_equal(bench.read("spatial_velocity"), np.zeros(6))


def test_outputs_are_those_of_the_pure_function(planner):
    bench = make_bench(planner, BEHIND)

    bench.advance_to(0.5 * PERIOD)

    expected = safe_entry_step(EntryState(), BEHIND, 0.0, planner)
    np.testing.assert_array_equal(bench.read("reference").positions, expected.reference.positions)
    assert bench.read("status")[0] == EntryStatus.FOLLOWING
    # The controller follows the plan, whose first motion is not the papers' through the wall.
    np.testing.assert_allclose(
        bench.read("target_points"), expected.reference.positions[0].ravel(), atol=1e-6
    )


def test_the_reference_stays_the_same_object_until_the_next_plan(planner):
    bench = make_bench(planner, BEHIND)
    bench.advance_to(0.5 * PERIOD)
    first = bench.read("reference")
    bench.advance_to(20.5 * PERIOD)
    second = bench.read("reference")

    bench.fix(points=ASIDE)
    # The points are checked at least every 1/16 s, with 0.1 s of patience.
    bench.advance_to(0.1)
    held = bench.read("reference")
    np.testing.assert_array_equal(bench.read("spatial_velocity"), np.zeros(6))
    assert bench.read("controller.status")[0] == ControllerStatus.HOLDING
    bench.advance_to(0.4)

    assert second is first
    assert held is ABSENT
    assert bench.read("reference") is not first
    np.testing.assert_allclose(bench.read("reference").positions[0], ASIDE, atol=1e-6)


@pytest.mark.parametrize(
    ("points", "status"), [(BEHIND, EntryStatus.FOLLOWING), (ASIDE, EntryStatus.HOLDING)]
)
def test_lost_points_do_not_change_the_outputs(planner, points, status):
    bench = make_bench(planner, BEHIND)
    bench.advance_to(0.5 * PERIOD)
    bench.fix(points=points)
    bench.advance_to(0.1)
    before = bench.read("reference")

    bench.fix(points=np.full(BODY.shape, np.nan))
    bench.advance_to(0.4)

    assert bench.read("reference") is before
    assert bench.read("status")[0] == status
    np.testing.assert_array_equal(bench.read("spatial_velocity"), np.zeros(6))


def test_a_controller_with_the_given_field_falls_back_to_the_papers(caged_planner):
    config = EntryMonitorConfig(max_attempts=1, fallback="field")
    bench = make_bench(caged_planner, BEHIND, config=config, bcsdm=BcsdmConfig())

    bench.advance_to(0.5 * PERIOD)
    bench.fix(points=BODY + GOAL - np.array([0.05, 0.0, 0.0]))
    bench.advance_to(1.5 * PERIOD)

    assert bench.read("status")[0] == EntryStatus.FAILED
    reference = caged_planner.model.reference
    np.testing.assert_array_equal(bench.read("reference").positions, reference.positions)
    papers = point_set_bcsdm(reference.positions[16], reference, BcsdmConfig())
    assert bench.read("tau")[0] == pytest.approx(papers.tau) == pytest.approx(0.5)


def test_each_plan_is_a_new_object_even_if_both_are_the_demonstration(planner):
    demonstration = planner.model.reference
    bench = make_bench(planner, demonstration.positions[30])
    bench.advance_to(0.5 * PERIOD)
    first = bench.read("reference")

    bench.fix(points=demonstration.positions[2] + np.array([0.0, 0.0, 0.1]))
    bench.advance_to(0.5)

    # So the controller does not use its time on the first as one on the second.
    second = bench.read("reference")
    assert second is not first
    for reference in (first, second):
        np.testing.assert_array_equal(reference.positions, demonstration.positions)


def test_nothing_feeds_through(planner):
    assert not SafeEntry(planner=planner).HasAnyDirectFeedthrough()

"""The judge of a mug that hangs, stands or lies: of given contacts, and of simulated ones."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from station_state import SetObjectPose

from poil_drake.diagrams.demonstration.recorder import MakeDemonstrationMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.run.task_success import HangingJudge, TouchedGeometries
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.model_parts import CollisionGeometries
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation, Station

ROD, TIP, STAND = "rack::rod::bar", "rack::rod::tip", "rack::stand::post"
TABLE, FINGER = "table::table::top", "panda::panda_leftfinger::pad"
OTHER_LINK_GEOMETRY, OTHER_MODEL = "rack::rod::base", "rack_of_the_neighbour::rod::bar"

DURATION = 2.0
BASE_TOP = 0.015
"""Height of the rack's base plate [m], see rack.sdf; the rack stands at (0.55, 0.30)."""


def judge(*observations: tuple[float, set[str]]) -> HangingJudge:
    dut = HangingJudge(fixture="rack", holder=frozenset({ROD, TIP}))
    for time, touched in observations:
        dut.observe(time, frozenset(touched))
    return dut


@pytest.mark.parametrize(
    ("observations", "hanging_time"),
    [
        pytest.param([(0.0, {FINGER, ROD}), (0.5, {ROD}), (2.5, {ROD})], 2.0, id="let go"),
        pytest.param([(0.0, {STAND}), (3.0, {STAND})], 0.0, id="stands on the base"),
        pytest.param([(0.0, {ROD}), (1.0, {ROD, STAND}), (2.0, {ROD})], 2.0, id="leans"),
        pytest.param([(0.0, {ROD}), (0.05, set()), (0.1, {ROD})], 0.1, id="swings"),
        pytest.param([(0.0, {ROD}), (0.05, set()), (0.2, set())], 0.0, id="falls"),
        pytest.param([(0.0, {ROD}), (0.5, {ROD, TABLE}), (0.75, {ROD}), (1.0, {ROD})], 0.25),
        pytest.param([(0.0, set()), (5.0, set())], 0.0, id="never touched the fixture"),
        pytest.param([(0.0, {OTHER_LINK_GEOMETRY}), (3.0, {OTHER_LINK_GEOMETRY})], 0.0),
        pytest.param([(0.0, {ROD}), (1.0, {ROD, OTHER_MODEL})], 0.0, id="model with same prefix"),
    ],
)
def test_hanging_time_since_nothing_but_the_fixture_is_touched(
    observations: list[tuple[float, set[str]]], hanging_time: float
) -> None:
    assert judge(*observations).hanging_time(observations[-1][0]) == hanging_time


def test_each_touched_link_is_named_once() -> None:
    assert judge((0.0, {ROD, TIP, TABLE})).touched_links == {"rack::rod", "table::table"}


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """The package's, with the same mug in the demonstration as on the table."""
    same = "{poil: {demonstration_object: 'package://poil_drake/mugs/mug_a/mug_a.sdf'}}"
    return ChooseScenario(data=same)


@pytest.fixture(scope="module")
def station(scenario: Scenario) -> Station:
    return MakeStation(scenario, cameras=False)


def watch(
    station: Station, X_WO: RigidTransform, *, rod: str = "rod"
) -> tuple[HangingJudge, frozenset[str]]:
    """Releases the mug at a pose; returns the judge afterwards, and all links that it touched."""
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    SetObjectPose(station, context, X_WO)
    plant, inspector = station.plant(), station.scene_graph().model_inspector()
    geometries = CollisionGeometries(plant, inspector, "rack", rod)
    holder = frozenset(f"rack::{g.link}::{g.name}" for g in geometries)
    judge, touched = HangingJudge(fixture="rack", holder=holder), frozenset[str]()
    for time in np.arange(1, 1 + round(32 * DURATION)) / 32:
        simulator.AdvanceTo(time)
        results = station.GetOutputPort("contact_results").Eval(context)
        judge.observe(time, TouchedGeometries(plant, inspector, results, "mug"))
        touched |= judge.touched_links
    return judge, touched


def test_a_mug_on_the_rod_hangs(station: Station, scenario: Scenario) -> None:
    scene = DemonstrationScene(scenario, cameras=False)
    motion = MakeDemonstrationMotion(scene, scenario.poil.demonstration_motion)

    dut, touched = watch(station, RigidTransform(motion.pose(motion.duration)))

    assert "rack::rod" in touched
    # It is released 3 mm above the rod and may bounce; then it hangs.
    assert dut.hanging_time(DURATION) > 0.5 * DURATION


def beside_the_post(x: float) -> RigidTransform:
    """The mug's bottom at the height of the rack's base plate, its handle away from the post."""
    return RigidTransform(RollPitchYaw(0, 0, np.pi), [x, 0.30, BASE_TOP + 0.0005])


@pytest.mark.parametrize(
    ("X_WO", "rod", "touched"),
    [
        (RigidTransform([0.45, -0.1, 0.0005]), "rod", {"table::table"}),
        # The whole bottom is on the plate.
        (beside_the_post(0.49), "rod", {"rack::stand"}),
        # The post is a geometry of the same link as the plate.
        (beside_the_post(0.49), "po[a-z]t", {"rack::stand"}),
        # Less than half of the bottom is above the plate, which ends at x = 0.47: it tips over.
        (beside_the_post(0.45), "rod", {"table::table", "rack::stand"}),
    ],
    ids=["on the table", "on the base", "beside the part", "across the edge"],
)
def test_a_mug_elsewhere_does_not_hang(
    station: Station, X_WO: RigidTransform, rod: str, touched: set[str]
) -> None:
    dut, found = watch(station, X_WO, rod=rod)

    assert found == touched
    assert dut.hanging_time(DURATION) == 0.0
    if rod != "rod":
        assert dut.holder == {"rack::stand::post"}

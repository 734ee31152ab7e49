import math
from pathlib import Path

import numpy as np
import pytest
from diagram_wiring import ports
from pydrake.math import RigidTransform
from station_state import GetObjectPose, SetObjectPose, SetRobotPosition
from system_bench import SystemBench

from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation, Station
from poil_drake.errors import ScenarioError, StationError

TEST_FILE = Path(__file__).parents[1] / "scenarios.yaml"
TABLE = "[{add_model: {name: table, file: 'package://poil_drake/fixtures/table.sdf'}},"
JOINT_SPEED = np.array([0.2, 0.0, 0.0, 0.1, 0.0, 0.0, -0.3])


@pytest.fixture(scope="module")
def station() -> Station:
    return MakeStation(ChooseScenario(), cameras=False)


@pytest.fixture
def bench(station: Station) -> SystemBench:
    bench = SystemBench(station)
    bench.simulator.Initialize()
    return bench


def test_the_ports_are_those_that_are_promised(station: Station) -> None:
    inputs, outputs = ports(station)

    robot_inputs = {"panda.velocity", "panda.velocity_time", "hand.width"}
    assert inputs.keys() == robot_inputs | {"applied_spatial_force"}
    assert outputs.keys() == {
        *("panda.position_measured", "panda.velocity_measured", "panda.torque_external"),
        *("panda.status", "hand.width_measured"),
        *("body_poses", "query_object", "contact_results", "plant_state"),
    }
    assert not station.scene_graph().HasRenderer("vtk")
    assert station.camera_names == ()


def test_at_rest_nothing_moves(station: Station, bench: SystemBench) -> None:
    before = GetObjectPose(station, bench.context)
    q = bench.read("panda.position_measured")

    bench.advance(0.5)

    moved = before.InvertAndCompose(GetObjectPose(station, bench.context))
    # A mug settles into its contacts by hundredths of a millimetre.
    assert np.linalg.norm(moved.translation()) < 5e-5
    assert abs(moved.rotation().ToAngleAxis().angle()) < 1e-3
    np.testing.assert_allclose(bench.read("panda.position_measured"), q, atol=1e-5)
    np.testing.assert_allclose(bench.read("hand.width_measured"), 0.08, atol=1e-5)
    np.testing.assert_allclose(bench.read("panda.torque_external"), 0.0, atol=1e-6)


def test_the_arm_follows_a_velocity(bench: SystemBench) -> None:
    q = bench.read("panda.position_measured")
    bench.fix("panda.velocity", JOINT_SPEED)

    bench.advance(0.5)

    np.testing.assert_allclose(bench.read("panda.velocity_measured"), JOINT_SPEED, atol=2e-3)
    # Filter (5 ms) and acceleration (up to 20 ms) delay the start.
    moved = bench.read("panda.position_measured") - q
    np.testing.assert_allclose(moved, 0.49 * JOINT_SPEED, atol=0.005)


@pytest.mark.parametrize("how", ["stale", "nan"])
def test_the_arm_stops_when_commands_fail(how: str, bench: SystemBench) -> None:
    bench.fix("panda.velocity", JOINT_SPEED)
    bench.fix("panda.velocity_time", 0.25)
    bench.advance_to(0.25)
    assert np.linalg.norm(bench.read("panda.velocity_measured")) > 0.3
    if how == "nan":
        bench.fix("panda.velocity", np.where(np.arange(7) == 2, math.nan, JOINT_SPEED))
        bench.advance_to(0.35)
    else:
        bench.advance_to(0.45)

    stopped = bench.read("panda.position_measured")
    bench.advance(0.25)

    np.testing.assert_allclose(bench.read("panda.position_measured"), stopped, atol=1e-3)


def test_the_hand_opens_and_closes_at_its_speed(bench: SystemBench) -> None:
    bench.fix("hand.width", 0.05)

    bench.advance_to(0.1)
    # 0.1 m/s from 0.08 m
    np.testing.assert_allclose(bench.read("hand.width_measured"), 0.07, atol=1e-3)
    bench.advance_to(0.5)
    np.testing.assert_allclose(bench.read("hand.width_measured"), 0.05, atol=1e-4)


def test_a_robot_that_was_put_somewhere_stays_there(station: Station, bench: SystemBench) -> None:
    bench.advance(0.05)
    q = np.array([0.3, -0.4, 0.1, -2.0, 0.2, 1.7, 0.5])

    SetRobotPosition(station, bench.context, q, width=0.04)
    bench.advance_to(0.25)

    np.testing.assert_allclose(bench.read("panda.position_measured"), q, atol=1e-4)
    np.testing.assert_allclose(bench.read("hand.width_measured"), 0.04, atol=1e-4)


def test_a_push_shows_in_the_external_torque(station: Station, bench: SystemBench) -> None:
    plant = station.plant()
    X_WH = plant.GetFrameByName("panda_hand_tcp").CalcPoseInWorld(
        plant.GetMyContextFromRoot(bench.context)
    )
    # The mug starts inside the hand; the contact pushes them apart.
    SetObjectPose(station, bench.context, RigidTransform(X_WH.translation()))
    bench.advance(0.01)

    assert np.linalg.norm(bench.read("panda.torque_external")) > 0.1


def test_a_wrong_robot_is_refused() -> None:
    scenario = ChooseScenario(data="{poil: {robot: table}}")

    with pytest.raises(StationError, match="'table' has no actuator 'panda_joint1'"):
        MakeStation(scenario, cameras=False)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{poil: {object: pot}}", "poil.object is 'pot'.*table, rack, panda, mug"),
        ("{poil: {part: spout}}", r"'spout' of 'mug'.*\(body, handle\)"),
        ("{directives: [{add_model: {name: a, file: no.sdf}}]}", "no.sdf"),
        ("{initial_position: {panda: {elbow: [0]}}}", "elbow"),
        ("{initial_position: {pandy: {panda_joint1: [0]}}}", "pandy"),
        ("{initial_position: {panda: {panda_joint1: [1, 2]}}}", r"positions in the input \(2\)"),
        # Degrees where radians are expected.
        (
            "{initial_position: {panda: {panda_joint6: [92]}}}",
            "_joint6' of 'panda' starts at 92 rad, beyond",
        ),
        ("{poil: {fixture: rak}}", "poil.fixture is 'rak'.*table, rack, panda, mug"),
        (
            "{poil: {demonstration_motion: {hanging: {rod: hook}}}}",
            r"rod is 'hook', but the fixture 'rack' has.*links \(rod, stand\).*\(base, post, rod\)",
        ),
        (
            "{poil: {disturbances: [{body: 'mugg::body', start: 1, duration: 1}]}}",
            "'mugg::body', but the plant has no body.*mug::body",
        ),
        ("{model_drivers: {pandy: {}}}", "model_drivers names 'pandy'.*'panda'"),
        ("{plant_config: {contact_model: soft}}", "plant_config .*'soft'"),
        ("{plant_config: {stiction_tolerance: -1}}", "plant_config cannot be used: Drake requires"),
        (
            f"{{directives: {TABLE} {{add_weld: {{parent: world, child: 'tabl::table'}}}}]}}",
            "'tabl'",
        ),
        (f"{{directives: {TABLE} {{add_weld: {{parent: world, child: 'table::top'}}}}]}}", "'top'"),
        (
            "{directives: [{add_model: {name: a, file: 'package://pail_drake/a.sdf'}}]}",
            "pail_drake",
        ),
    ],
)
def test_a_scenario_that_does_not_fit_is_refused(text: str, says: str) -> None:
    scenario = ChooseScenario(data=text)

    with pytest.raises(ScenarioError, match=says) as info:
        MakeStation(scenario, cameras=False)

    assert "\n" not in str(info.value)


def test_an_object_that_is_welded_is_refused() -> None:
    scenario = ChooseScenario()
    weld = "directives: [{add_weld: {parent: world, child: 'mug::body'}}]"
    scenario.directives.extend(LoadScenario(data=weld).directives)
    scenario.directives[-2].add_model.default_free_body_pose = {}

    with pytest.raises(ScenarioError, match="'mug' is welded"):
        MakeStation(scenario, cameras=False)


def test_a_joint_may_be_given_as_a_plain_number() -> None:
    scenario = ChooseScenario(data="{initial_position: {panda: {panda_joint1: 0.25}}}")

    plant = MakeStation(scenario, cameras=False).plant()

    assert plant.GetJointByName("panda_joint1").default_positions() == [0.25]


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        ("width: 0", "cameras.left cannot be used: .*Width"),
        ("width: 64000", "cameras.left has 64000 x 480 pixels.*at most 8192"),
        ("focal: !FovDegrees { y: 0 }", "cameras.left cannot be used: .*Focal"),
        ("renderer_class: RenderEngineRay", "cameras.left cannot be used: .*'RenderEngineRay'"),
        ("fps: 0", "cameras.left cannot be used: .*FPS"),
        ("z_near: 5", "cameras.left cannot be used: .*depth range"),
        ("renderer_name: ''", "cameras.left cannot be used: .*renderer_name"),
        ("X_PB: { base_frame: celing }", r"cameras.left.X_PB cannot be used: .*'celing'"),
        ("X_PB: { rotation: !Uniform {} }", r"cameras.left.X_PB cannot be used: Drake requires"),
        ("X_PB: { base_frame: 'panda::panda_hand' }", "'panda::panda_hand', which moves"),
        ("X_PB: { base_frame: 'mug::body' }", "'mug::body', which moves"),
        ("name: right", "under the key 'left' is named 'right'"),
        ("output_delay: 0.05", "right.output_delay is 0.109375 s, but .*left.output_delay is 0.05"),
        ("capture_offset: 0.01", "cameras.left.capture_offset is 0.01 s.*rates.tracker"),
    ],
)
def test_a_camera_that_cannot_be_used_is_refused(camera: str, says: str) -> None:
    scenario = ChooseScenario(data=f"{{cameras: {{left: {{{camera}}}}}}}")

    with pytest.raises(ScenarioError, match=says) as info:
        MakeStation(scenario)

    assert "\n" not in str(info.value)


def test_a_cameras_name_must_suit_ports_and_topics() -> None:
    scenario = ChooseScenario(data="{cameras: {a/b: {name: a/b, output_delay: 0.109375}}}")

    with pytest.raises(ScenarioError, match=r"name 'a/b'.*letters"):
        MakeStation(scenario)


def test_a_camera_may_be_mounted_on_what_is_welded_to_the_world() -> None:
    scenario = ChooseScenario(data="{cameras: {left: {X_PB: {base_frame: 'rack::stand'}}}}")

    assert MakeStation(scenario).camera_names == ("left", "right")


def test_the_error_of_an_empty_scenario_names_what_it_lacks() -> None:
    with pytest.raises(ScenarioError, match=r"poil.robot is 'panda'"):
        MakeStation(LoadScenario(filename=TEST_FILE, scenario_name="Defaults"))


def test_a_station_without_cameras_takes_no_pictures(station: Station) -> None:
    with pytest.raises(StationError, match="no cameras"):
        CaptureFrame(station, station.CreateDefaultContext())

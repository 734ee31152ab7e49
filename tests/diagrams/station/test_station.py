import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from station_state import GetObjectPose, SetObjectPose, SetRobotPosition

from poil_drake.diagrams.scenario.load import LoadScenario, default_scenario_file
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation, Station
from poil_drake.errors import ScenarioError, StationError

TEST_FILE = Path(__file__).parents[1] / "scenarios.yaml"
TABLE = "[{add_model: {name: table, file: 'package://poil_drake/fixtures/table.sdf'}},"
INPUTS = ["panda.velocity", "panda.velocity_time", "hand.width", "applied_spatial_force"]
OUTPUTS = [
    "panda.position_measured",
    "panda.velocity_measured",
    "panda.torque_external",
    "panda.status",
    "hand.width_measured",
    "body_poses",
    "query_object",
    "contact_results",
    "plant_state",
]
JOINT_SPEED = np.array([0.2, 0.0, 0.0, 0.1, 0.0, 0.0, -0.3])


@pytest.fixture(scope="module")
def station() -> Station:
    return MakeStation(LoadScenario(filename=default_scenario_file()), cameras=False)


@pytest.fixture
def simulator(station: Station) -> Simulator:
    simulator = Simulator(station)
    simulator.Initialize()
    return simulator


def output(station: Station, simulator: Simulator, name: str) -> np.ndarray:
    return station.GetOutputPort(name).Eval(simulator.get_context())


def test_the_ports_are_those_that_are_promised(station: Station) -> None:
    inputs = [station.get_input_port(i).get_name() for i in range(station.num_input_ports())]
    outputs = [station.get_output_port(i).get_name() for i in range(station.num_output_ports())]

    assert sorted(inputs) == sorted(INPUTS)
    assert sorted(outputs) == sorted(OUTPUTS)
    assert not station.scene_graph().HasRenderer("vtk")
    assert station.camera_names == ()


def test_at_rest_nothing_moves(station: Station, simulator: Simulator) -> None:
    before = GetObjectPose(station, simulator.get_context())
    q = output(station, simulator, "panda.position_measured").copy()

    simulator.AdvanceTo(0.5)

    moved = before.InvertAndCompose(GetObjectPose(station, simulator.get_context()))
    # A mug settles into its contacts by hundredths of a millimetre.
    assert np.linalg.norm(moved.translation()) < 5e-5
    assert abs(moved.rotation().ToAngleAxis().angle()) < 1e-3
    np.testing.assert_allclose(output(station, simulator, "panda.position_measured"), q, atol=1e-5)
    np.testing.assert_allclose(output(station, simulator, "hand.width_measured"), 0.08, atol=1e-5)
    np.testing.assert_allclose(output(station, simulator, "panda.torque_external"), 0.0, atol=1e-6)


def test_the_arm_follows_a_velocity(station: Station, simulator: Simulator) -> None:
    q = output(station, simulator, "panda.position_measured").copy()
    station.GetInputPort("panda.velocity").FixValue(simulator.get_mutable_context(), JOINT_SPEED)

    simulator.AdvanceTo(0.5)

    np.testing.assert_allclose(
        output(station, simulator, "panda.velocity_measured"), JOINT_SPEED, atol=2e-3
    )
    # Filter (5 ms) and acceleration (up to 20 ms) delay the start.
    np.testing.assert_allclose(
        output(station, simulator, "panda.position_measured") - q, 0.49 * JOINT_SPEED, atol=0.005
    )


@pytest.mark.parametrize("how", ["stale", "nan"])
def test_the_arm_stops_when_commands_fail(how: str, station: Station, simulator: Simulator) -> None:
    context = simulator.get_mutable_context()
    velocity, stamp = (station.GetInputPort(f"panda.{n}") for n in ("velocity", "velocity_time"))
    velocity.FixValue(context, JOINT_SPEED)
    stamp.FixValue(context, [0.25])
    simulator.AdvanceTo(0.25)
    assert np.linalg.norm(output(station, simulator, "panda.velocity_measured")) > 0.3
    if how == "nan":
        velocity.FixValue(context, np.where(np.arange(7) == 2, math.nan, JOINT_SPEED))
        simulator.AdvanceTo(0.35)
    else:
        simulator.AdvanceTo(0.45)

    stopped = output(station, simulator, "panda.position_measured").copy()
    simulator.AdvanceTo(simulator.get_context().get_time() + 0.25)

    np.testing.assert_allclose(
        output(station, simulator, "panda.position_measured"), stopped, atol=1e-3
    )


def test_the_hand_opens_and_closes_at_its_speed(station: Station, simulator: Simulator) -> None:
    station.GetInputPort("hand.width").FixValue(simulator.get_mutable_context(), [0.05])

    simulator.AdvanceTo(0.1)
    # 0.1 m/s from 0.08 m
    np.testing.assert_allclose(output(station, simulator, "hand.width_measured"), 0.07, atol=1e-3)
    simulator.AdvanceTo(0.5)
    np.testing.assert_allclose(output(station, simulator, "hand.width_measured"), 0.05, atol=1e-4)


def test_poses_are_set_and_read(station: Station, simulator: Simulator) -> None:
    context = simulator.get_mutable_context()
    X_WO = RigidTransform(RollPitchYaw(0.1, -0.7, 2.0), [0.5, 0.1, 0.6])

    SetObjectPose(station, context, X_WO)

    assert GetObjectPose(station, context).IsNearlyEqualTo(X_WO, 1e-12)


def test_a_robot_that_was_put_somewhere_stays_there(station: Station, simulator: Simulator) -> None:
    simulator.AdvanceTo(0.05)
    q = np.array([0.3, -0.4, 0.1, -2.0, 0.2, 1.7, 0.5])

    SetRobotPosition(station, simulator.get_mutable_context(), q, width=0.04)
    simulator.AdvanceTo(0.25)

    np.testing.assert_allclose(output(station, simulator, "panda.position_measured"), q, atol=1e-4)
    np.testing.assert_allclose(output(station, simulator, "hand.width_measured"), 0.04, atol=1e-4)


def test_a_push_shows_in_the_external_torque(station: Station, simulator: Simulator) -> None:
    plant = station.plant()
    X_WH = plant.GetFrameByName("panda_hand_tcp").CalcPoseInWorld(
        plant.GetMyContextFromRoot(simulator.get_context())
    )
    # The mug starts inside the hand, which presses it away and is pressed back.
    SetObjectPose(station, simulator.get_mutable_context(), RigidTransform(X_WH.translation()))
    simulator.AdvanceTo(0.01)

    assert np.linalg.norm(output(station, simulator, "panda.torque_external")) > 0.1


def test_a_wrong_robot_is_refused() -> None:
    scenario = LoadScenario(
        data="{poil: {robot: table}}", defaults=LoadScenario(filename=default_scenario_file())
    )

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
        # Degrees, where radians are wanted.
        ("{initial_position: {panda: {panda_joint6: [92]}}}", r"_joint6 is \[92.0\], beyond.*rad"),
        ("{poil: {fixture: rak}}", "poil.fixture is 'rak'.*table, rack, panda, mug"),
        (
            "{poil: {demonstration_motion: {hanging: {rod: hook}}}}",
            r"fixture 'rack' has no link.*'hook'.*links \(rod, stand\).*\(base, post, rod\)",
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
    scenario = LoadScenario(data=text, defaults=LoadScenario(filename=default_scenario_file()))

    with pytest.raises(ScenarioError, match=says) as info:
        MakeStation(scenario, cameras=False)

    assert "\n" not in str(info.value)


def test_an_object_that_is_welded_is_refused() -> None:
    scenario = LoadScenario(filename=default_scenario_file())
    weld = "directives: [{add_weld: {parent: world, child: 'mug::body'}}]"
    scenario.directives.extend(LoadScenario(data=weld).directives)
    del scenario.directives[-2].add_model.default_free_body_pose["body"]

    with pytest.raises(ScenarioError, match="'mug' is welded"):
        MakeStation(scenario, cameras=False)


def test_a_joint_may_be_given_as_a_plain_number(station: Station) -> None:
    scenario = LoadScenario(
        data="{initial_position: {panda: {panda_joint1: 0.25}}}",
        defaults=LoadScenario(filename=default_scenario_file()),
    )

    plant = MakeStation(scenario, cameras=False).plant()

    assert plant.GetJointByName("panda_joint1").default_positions() == [0.25]


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        ("width: 0", "cameras.left cannot be used: .*Width"),
        ("width: 64000", "cameras.left has 64000 x 480 pixels.*At most 8192"),
        ("focal: !FovDegrees { y: 0 }", "cameras.left cannot be used: .*Focal"),
        ("renderer_class: RenderEngineRay", "cameras.left cannot be used: .*'RenderEngineRay'"),
        ("fps: .inf", "cameras.left cannot be used: .*FPS"),
        ("z_near: 5", "cameras.left cannot be used: .*depth range"),
        ("renderer_name: ''", "cameras.left cannot be used: .*renderer_name"),
        ("X_PB: { base_frame: celing }", r"cameras.left.X_PB cannot be used: .*'celing'"),
        ("X_PB: { rotation: !Uniform {} }", r"cameras.left.X_PB cannot be used: Drake requires"),
        ("X_PB: { translation: [.inf, 0, 0] }", r"cameras.left.X_PB is not finite"),
        ("X_BD: { translation: [.inf, 0, 0] }", r"cameras.left.X_BD is not finite"),
        ("X_PB: { base_frame: 'panda::panda_hand' }", "'panda::panda_hand', which moves"),
        ("X_PB: { base_frame: 'mug::body' }", "'mug::body', which moves"),
        ("name: right", "under the key 'left' is named 'right'"),
        ("output_delay: 0.05", "right.output_delay is 0.09375 s, but .*left.output_delay is 0.05"),
        ("capture_offset: 0.01", "cameras.left.capture_offset is 0.01 s.*rates.tracker"),
    ],
)
def test_a_camera_that_cannot_be_used_is_refused(camera: str, says: str) -> None:
    scenario = LoadScenario(
        data=f"{{cameras: {{left: {{{camera}}}}}}}",
        defaults=LoadScenario(filename=default_scenario_file()),
    )

    with pytest.raises(ScenarioError, match=says) as info:
        MakeStation(scenario)

    assert "\n" not in str(info.value)


def test_a_cameras_name_must_suit_ports_and_topics() -> None:
    scenario = LoadScenario(
        data="{cameras: {a/b: {name: a/b, output_delay: 0.09375}}}",
        defaults=LoadScenario(filename=default_scenario_file()),
    )

    with pytest.raises(ScenarioError, match=r"named 'a/b'.*letters"):
        MakeStation(scenario)


def test_a_camera_may_be_mounted_on_what_is_welded_to_the_world() -> None:
    scenario = LoadScenario(
        data="{cameras: {left: {X_PB: {base_frame: 'rack::stand'}}}}",
        defaults=LoadScenario(filename=default_scenario_file()),
    )

    assert MakeStation(scenario).camera_names == ("left", "right")


def test_an_empty_scenario_says_what_it_lacks() -> None:
    with pytest.raises(ScenarioError, match=r"poil.robot is 'panda'"):
        MakeStation(LoadScenario(filename=TEST_FILE, scenario_name="Defaults"))


def test_a_station_without_cameras_takes_no_pictures(
    station: Station, simulator: Simulator
) -> None:
    with pytest.raises(StationError, match="no cameras"):
        CaptureFrame(station, simulator.get_context())

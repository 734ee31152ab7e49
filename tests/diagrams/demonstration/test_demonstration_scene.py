import numpy as np
import pytest

from poil_drake.diagrams.demonstration.scene import DemonstrationScene, demonstrated_parts
from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform


@pytest.fixture(scope="module")
def dut():
    return DemonstrationScene(ChooseScenario(), cameras=False)


def test_the_distance_to_the_table_is_negative_within_it(dut):
    X_WO = make_transform(np.eye(3), [0.4, 0.0, -0.004])

    assert dut.distance(X_WO, ".*", "table", ".*") == pytest.approx(-0.004, abs=1e-4)


def test_the_distance_between_links(dut):
    # The mug's bottom is 0.12 m straight above the post's top, but for the feet that it stands on.
    X_WO = make_transform(np.eye(3), [0.55, 0.30, 0.40])

    assert dut.distance(X_WO, "body", "rack", "stand") == pytest.approx(0.12, abs=3e-3)


def test_the_box_around_the_rod(dut):
    [(X_WB, half)] = dut.boxes("rack", "rod")

    # A capsule of 0.14 m and radius 5.5 mm, which leaves (0.55, 0.30, 0.26) 15 degrees upwards.
    np.testing.assert_allclose(sorted(half), [0.0055, 0.0055, 0.0755], atol=1e-6)
    u = np.array([0.0, -np.cos(np.radians(15)), np.sin(np.radians(15))])
    np.testing.assert_allclose(X_WB[:3, 3], [0.55, 0.30, 0.26] + 0.07 * u, atol=1e-5)
    assert dut.boxes("rack", "hook") == []
    # An invalid pattern matches no part.
    assert dut.boxes("rack", "(") == []


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("{}", {"handle": "handle"}),
        # The patterns are those of the user's own mug; the package's has a link named "handle".
        ("{parts: {handle: 'grip_.*', lid: lid}}", {"handle": "handle"}),
        ("{part: grip, parts: {grip: 'grip_.*'}}", {"grip": "handle"}),
        (
            "{demonstration_object: mug.xml, parts: {handle: 'grip_.*', lid: lid}}",
            {"handle": "grip_.*", "lid": "lid"},
        ),
    ],
)
def test_the_packages_mugs_have_a_part_called_handle(text, parts):
    assert demonstrated_parts(ChooseScenario(data=f"{{poil: {text}}}").poil) == parts


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{poil: {fixture: hook}}", r"poil\.fixture is 'hook'.*rack"),
        ("{initial_position: {rack: {elbow: [0]}}}", "initial_position cannot be set: .*elbow"),
        ("{initial_position: {rak: {elbow: [0]}}}", "initial_position cannot be set: .*'rak'"),
    ],
)
def test_unknown_names_are_named(text, says):
    with pytest.raises(ScenarioError, match=says):
        DemonstrationScene(ChooseScenario(data=text), cameras=False)


def test_the_object_must_be_free():
    scenario = ChooseScenario()
    weld = "directives: [{add_weld: {parent: world, child: 'mug::body'}}]"
    scenario.directives.extend(LoadScenario(data=weld).directives)

    with pytest.raises(ScenarioError, match="'mug' is welded"):
        DemonstrationScene(scenario, cameras=False)


def test_initial_positions_of_robot_and_object_are_ignored():
    scenario = ChooseScenario(data="{initial_position: {mug: {lid_hinge: [0]}}}")

    DemonstrationScene(scenario, cameras=False)


@pytest.mark.render
def test_a_camera_on_the_robot_is_refused():
    mounted = ChooseScenario(data="{cameras: {left: {X_PB: {base_frame: 'panda::panda_link0'}}}}")

    with pytest.raises(ScenarioError, match=r"left\.X_PB .*'panda'.* name a frame that is welded"):
        DemonstrationScene(mounted)

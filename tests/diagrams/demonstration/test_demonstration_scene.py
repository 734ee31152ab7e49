from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import PackageMap

from poil_drake.diagrams.demonstration.directives import (
    demonstrated_parts,
    demonstration_directives,
)
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform

GRIPPER = """<robot name="tool"><link name="base"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


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
    welded = with_more("[{add_weld: {parent: world, child: 'mug::body'}}]")

    with pytest.raises(ScenarioError, match="'mug' is welded"):
        DemonstrationScene(welded, cameras=False)


def test_initial_positions_of_robot_and_object_are_ignored():
    scenario = ChooseScenario(data="{initial_position: {mug: {lid_hinge: [0]}}}")

    DemonstrationScene(scenario, cameras=False)


@pytest.mark.render
def test_a_camera_on_the_robot_is_refused():
    mounted = ChooseScenario(data="{cameras: {left: {X_PB: {base_frame: 'panda::panda_link0'}}}}")

    with pytest.raises(ScenarioError, match=r"left\.X_PB .*'panda'.* name a frame that is welded"):
        DemonstrationScene(mounted)


def with_more(more: str) -> Scenario:
    """Returns the package's scenario with directives added."""
    scenario = ChooseScenario()
    scenario.directives.extend(LoadScenario(data=f"directives: {more}").directives)
    return scenario


def directives(scenario: Scenario) -> list:
    return demonstration_directives(scenario, PackageMap.MakeEmpty())[0]


def models(scenario: Scenario) -> dict[str, str]:
    added = (d.add_model for d in directives(scenario))
    return {model.name: model.file for model in added if model is not None}


def test_the_robot_is_removed_and_the_object_replaced() -> None:
    assert models(ChooseScenario()) == {
        "table": "package://poil_drake/fixtures/table.sdf",
        "rack": "package://poil_drake/fixtures/rack.sdf",
        "mug": "package://poil_drake/mugs/mug_demo/mug_demo.sdf",
    }


def test_the_scenario_keeps_its_own_object() -> None:
    scenario = ChooseScenario()
    files = [d.add_model.file for d in scenario.directives if d.add_model is not None]

    directives(scenario)

    assert [d.add_model.file for d in scenario.directives if d.add_model is not None] == files
    assert scenario.directives[-1].add_model.default_free_body_pose


def test_models_welded_to_the_robot_are_removed(tmp_path: Path) -> None:
    tool = tmp_path / "tool.urdf"
    tool.write_text(GRIPPER)
    scenario = with_more(
        "[{add_frame: {name: mount, X_PF: {base_frame: 'panda::panda_hand'}}},"
        "{add_frame: {name: slanted, X_PF: {base_frame: mount, rotation: !Rpy {deg: [9, 0, 0]}}}},"
        f"{{add_model: {{name: probe, file: '{tool}'}}}},"
        "{add_weld: {parent: slanted, child: 'probe::base'}},"
        f"{{add_model: {{name: tip, file: '{tool}'}}}},"
        "{add_weld: {parent: 'probe::base', child: 'tip::base'}}]"
    )

    removed = demonstration_directives(scenario, PackageMap.MakeEmpty())[1]
    assert removed == {"panda", "probe", "tip"}
    assert set(models(scenario)) == {"table", "rack", "mug"}
    DemonstrationScene(scenario, cameras=False)


def test_the_robots_base_is_kept(tmp_path: Path) -> None:
    base = tmp_path / "base.urdf"
    base.write_text(GRIPPER)
    scenario = with_more(
        f"[{{add_model: {{name: base, file: '{base}'}}}},"
        "{add_weld: {parent: world, child: 'base::base'}},"
        "{add_weld: {parent: 'base::base', child: 'panda::panda_link0'}}]"
    )

    assert set(models(scenario)) == {"table", "rack", "mug", "base"}


def test_collision_filters_are_removed() -> None:
    scenario = with_more("[{add_collision_filter_group: {name: arm, members: ['panda::hand']}}]")

    assert all(d.add_collision_filter_group is None for d in directives(scenario))


def test_files_of_directives_are_read(tmp_path: Path) -> None:
    file = tmp_path / "robot.dmd.yaml"
    file.write_text(
        "directives:\n"
        "- add_model: { name: panda, file: package://poil_drake_panda/panda.urdf }\n"
        "- add_weld: { parent: world, child: 'panda::panda_link0' }\n"
    )
    scenario = with_more(f"[{{add_directives: {{file: '{file}'}}}}]")
    scenario.directives[:] = [d for d in scenario.directives if not _is_the_robots(d)]

    assert set(models(scenario)) == {"table", "rack", "mug"}
    DemonstrationScene(scenario, cameras=False)


def _is_the_robots(directive) -> bool:
    if directive.add_model is not None:
        return directive.add_model.name == "panda"
    return directive.add_weld is not None and directive.add_weld.child.startswith("panda::")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (
            "{add_directives: {file: nowhere.yaml}}",
            r"add_directives.*nowhere\.yaml.*Correct",
        ),
        (
            "{add_weld: {parent: 'panda::panda_hand', child: 'rack::stand'}}",
            "fixture 'rack' is welded to the robot 'panda'",
        ),
        ("{add_weld: {parent: world, child: stand}}", "'stand' without its.*Use <model>::stand"),
    ],
)
def test_unsuitable_directives_are_refused(more: str, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        directives(with_more(f"[{more}]"))

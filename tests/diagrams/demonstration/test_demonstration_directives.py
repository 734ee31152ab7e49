from pathlib import Path

import pytest
from pydrake.multibody.parsing import PackageMap

from poil_drake.diagrams.demonstration.directives import demonstration_directives
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError

GRIPPER = """<robot name="tool"><link name="base"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


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
        ("{add_directives: {file: nowhere.yaml}}", r"directives.*nowhere\.yaml.*add_directives"),
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

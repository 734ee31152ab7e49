"""Directives as people write them: welds, frames, poses, filters and files of directives."""

from pathlib import Path

import numpy as np
import pytest
from own_models import PACKAGE_MUG, add_mug, mjcf_file, mjcf_rack, own_scenario, sdf_file

from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.scenario.model_parts import ModelBodies
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.errors import ScenarioError


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("{add_weld: {parent: 'mug::body', child: world}}", "exchange its parent and child"),
        ("{add_weld: {parent: world, child: 'rak::stand'}}", "'rak'.*below the one that adds"),
        ("{add_weld: {parent: world, child: 'rack::stand'}}", "Weld each link only once"),
        (
            "{add_weld: {parent: 'table::table', child: 'rack::rod'}}",
            "do not fit together.*Remove a weld",
        ),
        (
            "{add_weld: {parent: world, child: 'mug::body', X_PC: {translation: [.inf, 0, 0]}}}",
            "X_PC",
        ),
        (
            "{add_frame: {name: a, X_PF: {base_frame: world, rotation: !Uniform {}}}}",
            "X_PF of the frame 'a' cannot be used.*no random",
        ),
        (
            f"{{add_model: {{name: a, file: '{PACKAGE_MUG}', "
            "default_joint_positions: {b: [1]}}}",
            "no Joint named 'b' .*Correct the name of the joint",
        ),
        (add_mug(), "'mug'.*Give each add_model a name"),
        ("{add_model: {name: a, file: a.urdf.xacro}}", "expand a .xacro"),
        ("{add_model: {name: a, file: torn.urdf}}", "torn.urdf.*Correct the XML"),
        ("{add_model: {name: a, file: stl.xml}}", r"a.stl.*Convert the mesh to .obj"),
        (
            add_mug(name="other", pose="rotation: !Uniform {}"),
            "'other::body' .*no random",
        ),
        (
            add_mug(name="other", pose="base_frame: shelf"),
            "base_frame .*'other::body' .*'shelf'",
        ),
    ],
)
def test_mistakes_in_directives_are_explained(change: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "a.urdf.xacro").write_text("<robot/>")
    (tmp_path / "torn.urdf").write_text("<robot name='a'><link")
    (tmp_path / "a.stl").write_text("solid a\nendsolid a\n")
    mesh = "<asset><mesh name='a' file='a.stl'/></asset><worldbody><geom type='mesh' mesh='a'/>"
    (tmp_path / "stl.xml").write_text(f"<mujoco>{mesh}</worldbody></mujoco>")
    (tmp_path / "scene.yaml").write_text(f"Own: {own_scenario(more=change)}")

    with pytest.raises(ScenarioError, match=says) as info:
        MakeStation(LoadScenario(filename=tmp_path / "scene.yaml"), cameras=False)

    assert "\n" not in str(info.value)


STATIC_RACK = """<model name="rack"><static>true</static><link name="stand"><pose>1 0 0 0 0 0</pose>
<collision name="rod"><geometry><capsule><radius>0.005</radius><length>0.1</length></capsule>
</geometry></collision></link></model>"""


@pytest.mark.parametrize(
    ("text", "name", "place"),
    [
        (mjcf_file(mjcf_rack()), "rack.xml", [0.55, 0.30, 0.0]),
        (sdf_file(STATIC_RACK), "rack.sdf", [1.0, 0.0, 0.0]),
    ],
)
def test_a_rack_that_its_file_welds_is_not_welded_again(
    text: str, name: str, place: list[float], tmp_path: Path
) -> None:
    file = tmp_path / name
    file.write_text(text)
    options = {"rack": file, "poil": "demonstration_motion: {hanging: {rod: 'rod.*'}}"}

    with pytest.raises(ScenarioError, match=r"needs no add_weld: write its pose into the file"):
        MakeStation(ChooseScenario(data=own_scenario(**options)), cameras=False)

    scenario = ChooseScenario(data=own_scenario(**options, weld_rack=""))
    plant = MakeStation(scenario, cameras=False).plant()
    X_WS = plant.GetBodyByName("stand").EvalPoseInWorld(plant.CreateDefaultContext())
    np.testing.assert_allclose(X_WS.translation(), place, atol=1e-9)


def test_a_filter_may_name_bodies_of_several_models() -> None:
    group = "{add_collision_filter_group: {name: loose, members: ['mug::body', 'table::table'], "
    group += "ignored_collision_filter_groups: [loose]}}"
    scenario = ChooseScenario(data=own_scenario(more=group))

    station = MakeStation(scenario, cameras=False)

    plant, inspector = station.plant(), station.scene_graph().model_inspector()
    mug, table = (
        plant.GetCollisionGeometriesForBody(plant.get_body(ModelBodies(plant, name)[0]))[0]
        for name in ("mug::body", "table::table")
    )
    assert inspector.CollisionFiltered(mug, table)


def test_directives_of_a_file_may_have_a_namespace(tmp_path: Path) -> None:
    rules = "{add_collision_filter_group: {name: g, members: ['mug::body', 'stand::table'], "
    rules += "ignored_collision_filter_groups: [g]}}"
    table = "{add_model: {name: stand, file: 'package://poil_drake/fixtures/table.sdf'}}"
    weld = "{add_weld: {parent: world, child: 'stand::table', X_PC: {translation: [0, 0, 0.5]}}}"
    file = tmp_path / "corner.dmd.yaml"
    file.write_text(f"directives: [{table}, {weld}, {add_mug()}, {rules}]")
    space = "{add_model_instance: {name: lab}}"
    added = f"{{add_directives: {{file: '{file}', model_namespace: lab}}}}"
    data = own_scenario(mug="", more=f"{space}, {added}", poil="object: 'lab::mug'")

    station = MakeStation(ChooseScenario(data=data), cameras=False)

    pose = station.object_body().EvalPoseInWorld(station.plant().CreateDefaultContext())
    np.testing.assert_allclose(pose.translation(), [0.47, -0.12, 0.0], atol=1e-9)
    assert {"lab::mug", "lab::mug/handle", "lab"} <= set(station.label_ids)

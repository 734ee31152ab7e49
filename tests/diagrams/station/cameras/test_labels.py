import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from poil_drake.diagrams.station.cameras.labels import AssignLabels, drawn_geometries
from poil_drake.errors import ScenarioError

URDF = """<robot name="pan">
  <link name="bowl">
    <visual name="disc"><geometry><cylinder radius="0.1" length="0.03"/></geometry></visual>
    <visual name="grip_1"><geometry><box size="0.1 0.02 0.02"/></geometry></visual>
    <visual name="grip_2"><geometry><box size="0.1 0.02 0.02"/></geometry></visual>
  </link>
  <link name="lid"><visual name="plate"><geometry><sphere radius="0.1"/></geometry></visual></link>
  <joint name="weld" type="fixed"><parent link="bowl"/><child link="lid"/></joint>
</robot>"""


@pytest.fixture
def scene() -> tuple[MultibodyPlant, SceneGraph, DiagramBuilder]:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.01)
    Parser(plant, "a").AddModelsFromString(URDF, "urdf")
    Parser(plant, "b").AddModelsFromString(URDF, "urdf")
    return plant, scene_graph, builder


def labels_by_name(plant: MultibodyPlant, scene_graph: SceneGraph, model: str) -> dict[str, int]:
    inspector = scene_graph.model_inspector()
    instance = plant.GetModelInstanceByName(model)
    return {
        g.name: int(inspector.GetPerceptionProperties(g.id).GetProperty("label", "id"))
        for g in drawn_geometries(plant, scene_graph, instance)
    }


def test_parts_are_found_by_link_and_by_geometry_name(scene) -> None:
    plant, scene_graph, _ = scene

    dut = AssignLabels(
        plant=plant,
        scene_graph=scene_graph,
        parts={"a::pan": {"lid": "lid", "grip": "grip_[0-9]"}},
    )

    drawn = labels_by_name(plant, scene_graph, "a::pan")
    assert (drawn["plate"],) == dut["a::pan/lid"]
    assert drawn["grip_1"] == drawn["grip_2"] == dut["a::pan/grip"][0]
    assert set(drawn.values()) == set(dut["a::pan"])
    assert len(dut["a::pan"]) == 3


def test_every_model_has_labels_of_its_own(scene) -> None:
    plant, scene_graph, _ = scene

    dut = AssignLabels(plant=plant, scene_graph=scene_graph, parts={"a::pan": {"lid": "lid"}})

    assert set(dut) == {"a::pan", "a::pan/lid", "b::pan"}
    assert not set(dut["a::pan"]) & set(dut["b::pan"])
    assert set(labels_by_name(plant, scene_graph, "b::pan").values()) == set(dut["b::pan"])


def test_colours_are_kept(scene) -> None:
    plant, scene_graph, _ = scene
    instance = plant.GetModelInstanceByName("a::pan")

    def have_colours() -> list[bool]:
        inspector = scene_graph.model_inspector()
        return [
            inspector.GetPerceptionProperties(g.id).HasProperty("phong", "diffuse")
            for g in drawn_geometries(plant, scene_graph, instance)
        ]

    before = have_colours()

    AssignLabels(plant=plant, scene_graph=scene_graph, parts={})

    assert have_colours() == before


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"a::pan": {"spout": "spout"}}, r"'spout'.*links \(bowl, lid\).*disc, grip_1, grip_2"),
        ({"a::pan": {"grip": "grip_("}}, "an invalid regular expression"),
        ({"a::pan": {"grip": "grip_.", "first": "grip_1"}}, "'grip_1'.*two parts"),
        ({"pot": {"grip": "grip"}}, "'pot'.*a::pan, b::pan"),
        # A pattern must match the whole name.
        ({"a::pan": {"grip": "grip"}}, "'grip'"),
    ],
)
def test_parts_that_do_not_fit_are_named(scene, parts: dict, says: str) -> None:
    plant, scene_graph, _ = scene

    with pytest.raises(ScenarioError, match=says):
        AssignLabels(plant=plant, scene_graph=scene_graph, parts=parts)

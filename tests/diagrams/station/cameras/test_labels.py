import pytest
from pydrake.geometry import PerceptionProperties, Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from poil_drake.diagrams.scenario.model_parts import ModelGeometries
from poil_drake.diagrams.station.cameras.labels import AssignLabels
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


class Scene:
    """The models a::pan and b::pan."""

    def __init__(self) -> None:
        self.builder = DiagramBuilder()  # Owns the plant.
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(self.builder, time_step=0.01)
        for prefix in "ab":
            Parser(self.plant, prefix).AddModelsFromString(URDF, "urdf")

    def assign(self, parts: dict) -> dict[str, tuple[int, ...]]:
        return AssignLabels(plant=self.plant, scene_graph=self.scene_graph, parts=parts)

    def properties(self, model: str) -> dict[str, PerceptionProperties]:
        """Returns what cameras see of a model, by the names of its geometries."""
        inspector = self.scene_graph.model_inspector()
        found = ModelGeometries(self.plant, inspector, model, Role.kPerception)
        return {g.name: inspector.GetPerceptionProperties(g.id) for g in found}

    def labels(self, model: str) -> dict[str, int]:
        found = self.properties(model).items()
        return {name: int(seen.GetProperty("label", "id")) for name, seen in found}


@pytest.fixture
def scene() -> Scene:
    return Scene()


def test_parts_are_found_by_link_and_by_geometry_name(scene: Scene) -> None:
    dut = scene.assign({"a::pan": {"lid": "lid", "grip": "grip_[0-9]"}})

    drawn = scene.labels("a::pan")
    assert (drawn["plate"],) == dut["a::pan/lid"]
    assert drawn["grip_1"] == drawn["grip_2"] == dut["a::pan/grip"][0]
    assert set(drawn.values()) == set(dut["a::pan"])
    assert len(dut["a::pan"]) == 3


def test_the_order_of_parts_does_not_matter(scene: Scene) -> None:
    dut = scene.assign({"a::pan": {"lid": "lid", "grip": "grip_[0-9]"}})

    assert dut == Scene().assign({"a::pan": {"grip": "grip_[0-9]", "lid": "lid"}})


def test_every_model_has_labels_of_its_own(scene: Scene) -> None:
    dut = scene.assign({"a::pan": {"lid": "lid"}})

    assert set(dut) == {"a::pan", "a::pan/lid", "b::pan"}
    assert not set(dut["a::pan"]) & set(dut["b::pan"])
    assert set(scene.labels("b::pan").values()) == set(dut["b::pan"])


def test_colours_are_kept(scene: Scene) -> None:
    def have_colours() -> list[bool]:
        return [p.HasProperty("phong", "diffuse") for p in scene.properties("a::pan").values()]

    before = have_colours()

    scene.assign({})

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
def test_parts_that_do_not_fit_are_named(scene: Scene, parts: dict, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        scene.assign(parts)

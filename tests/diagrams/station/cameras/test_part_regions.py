"""Parts of a single mesh, told by a region."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from trimesh.visual import TextureVisuals
from trimesh.visual.material import SimpleMaterial

import poil_drake.models
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.poil_config import PartRegion
from poil_drake.diagrams.station.cameras.part_regions import SeparateParts
from poil_drake.diagrams.station.station_models import MakeUnsimulatedPlant
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform

MUG = Path(poil_drake.models.__file__).parent / "mugs/mug_a"
STANDS = make_transform(np.eye(3), [0.45, -0.1, 0.0])

SDF = """<sdf version="1.9"><model name="one"><link name="all">
<inertial><mass>0.3</mass></inertial>
<visual name="mesh"><geometry><mesh><uri>all.obj</uri><scale>0.001 0.001 0.001</scale></mesh>
</geometry></visual>
<collision name="box"><geometry><box><size>0.1 0.1 0.1</size></box></geometry></collision>
</link></model></sdf>"""


@pytest.fixture(scope="module")
def one_mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of mug_a whose body and handle are one mesh, in millimetres."""
    folder = tmp_path_factory.mktemp("one_mesh")
    mesh = trimesh.util.concatenate(pieces())
    mesh.export(folder / "all.obj", include_normals=True)
    (folder / "one.sdf").write_text(SDF)
    return folder / "one.sdf"


def pieces() -> list[trimesh.Trimesh]:
    """Returns the body and the handle of mug_a [mm]."""
    found = [
        trimesh.load(MUG / f"mug_a_{part}.obj", force="mesh", process=False)
        for part in ("body", "handle")
    ]
    for piece in found:
        piece.vertices *= 1000.0
    return found


def images(file: Path, handle: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns the colour images (2, H, W, 3) of an object, and the masks of its handle."""
    poil = f"{{demonstration_object: {file}, demonstration_parts: {{handle: {handle}}}}}"
    dut = DemonstrationScene(ChooseScenario(data=f"{{poil: {poil}}}"))
    dut.put_object(STANDS)
    frame = dut.capture(0.0, labels=True)
    (label,) = frame.label_ids["mug/handle"]
    rgb, labels = zip(*((image.rgb, image.label) for image in frame.images), strict=True)
    return np.array(rgb), np.array(labels) == label


@pytest.mark.render
def test_a_region_is_labelled_as_a_part_and_keeps_its_looks(one_mesh: Path) -> None:
    colours, handles = images(one_mesh, "!PartRegion {lower: [0.0445, -.inf, -.inf]}")

    # The mug whose handle is a separate mesh.
    _, expected = images(MUG / "mug_a.sdf", "handle")
    either, both = (handles | expected).sum(axis=(1, 2)), (handles & expected).sum(axis=(1, 2))
    assert (both > 0.9 * either).all()
    assert (expected.sum(axis=(1, 2)) > 100).all()
    whole, _ = images(one_mesh, "all")
    assert (colours != whole).any(axis=3).mean() < 1e-3


@pytest.mark.render
def test_a_mesh_of_two_materials_keeps_their_colours(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for piece, diffuse in zip(pieces(), ([230, 26, 26, 255], [26, 26, 230, 255]), strict=True):
        piece.visual = TextureVisuals(material=SimpleMaterial(diffuse=diffuse))
        scene.add_geometry(piece)
    scene.export(tmp_path / "all.obj", include_normals=True)
    (tmp_path / "one.sdf").write_text(SDF)

    colours, handles = images(tmp_path / "one.sdf", "!PartRegion {lower: [0.0445, -.inf, -.inf]}")

    whole, _ = images(tmp_path / "one.sdf", "all")
    assert np.median(whole[handles], axis=0)[2] > 100
    np.testing.assert_allclose(colours[handles].mean(axis=0), whole[handles].mean(axis=0), atol=15)


def test_the_targets_part_is_told_apart_from_the_demonstrations(one_mesh: Path) -> None:
    scenario = ChooseScenario(
        data="{poil: {parts: {handle: !PartRegion {lower: [0.0445, -.inf, -.inf]}}}}"
    )
    (mug,) = (d.add_model for d in scenario.directives if d.add_model and d.add_model.name == "mug")
    mug.file, mug.default_free_body_pose = one_mesh.as_uri(), {}

    *_, label_ids = MakeUnsimulatedPlant(scenario)
    demonstrated = DemonstrationScene(scenario, cameras=False)

    assert len(label_ids["mug/handle"]) == 1
    assert demonstrated.part_link == "handle"


def test_a_mesh_whose_y_axis_points_up_is_split_as_drake_turns_it(tmp_path: Path) -> None:
    # A pillar, 0.4 m high along its file's y axis, on the link's origin.
    pillar = trimesh.creation.box((0.1, 0.4, 0.2)).subdivide()
    pillar.apply_translation((0.0, 0.2, 0.0))
    trimesh.exchange.export.export_mesh(pillar, tmp_path / "all.gltf")
    sdf = SDF.replace("all.obj", "all.gltf").replace("0.001", "1")
    (tmp_path / "one.sdf").write_text(sdf)
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    Parser(plant).AddModels(str(tmp_path / "one.sdf"))

    SeparateParts(plant, scene_graph, "one", {"top": PartRegion(lower=(-1.0, -1.0, 0.2))})

    inspector, top = scene_graph.model_inspector(), []
    for found in inspector.GetAllGeometryIds(Role.kPerception):
        if inspector.GetName(found).endswith("/top"):
            hull = inspector.GetShape(found).GetConvexHull()
            top = [hull.vertex(i) for i in range(hull.num_vertices())]
    np.testing.assert_allclose(np.min(top, axis=0), [-0.05, -0.1, 0.2], atol=1e-6)
    np.testing.assert_allclose(np.max(top, axis=0), [0.05, 0.1, 0.4], atol=1e-6)


def test_a_region_without_triangles_is_refused() -> None:
    data = "{poil: {demonstration_parts: {handle: !PartRegion {lower: [1, 1, 1]}}}}"

    with pytest.raises(ScenarioError, match=r"'handle' contains no triangle .*'mug'.*body, handle"):
        DemonstrationScene(ChooseScenario(data=data), cameras=False)


def test_points_in_a_turned_region() -> None:
    dut = PartRegion(upper=(0.1, np.inf, np.inf), rpy=(0.0, 0.0, 90.0))

    # The box's x axis is the link's y axis.
    assert dut.contains(np.array([[5.0, 0.0, 0.0], [0.0, 0.2, 0.0]])).tolist() == [True, False]


def test_an_empty_region_is_refused() -> None:
    data = "{poil: {parts: {handle: !PartRegion {lower: [1, 0, 0], upper: [0, 1, 1]}}}}"

    with pytest.raises(ScenarioError, match=r"region reaches from .* so it is empty"):
        ChooseScenario(data=data)

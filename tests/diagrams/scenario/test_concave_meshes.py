import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.systems.framework import DiagramBuilder

from poil_drake.diagrams.scenario.concave_meshes import ReplaceConcaveMeshes
from poil_drake.diagrams.scenario.model_parts import CollisionGeometries
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import MissingDependencyError, ScenarioError

SDF = """<sdf version="1.9"><model name="cup"><link name="handle"><collision name="grip">
<pose>0 0 0.1 0 0 0</pose>
<geometry><mesh><uri>{file}</uri><scale>{scale} {scale} {scale}</scale></mesh></geometry>
</collision></link></model></sdf>"""
MJCF = """<mujoco model="cup"><asset><mesh name="m" file="{file}" scale="{scale} {scale} {scale}"/>
</asset><worldbody><body name="handle"><geom name="grip" type="mesh" mesh="m" pos="0 0 0.1"/>
</body></worldbody></mujoco>"""
URDF = """<robot name="cup"><link name="handle"><collision name="grip"><origin xyz="0 0 0.1"/>
<geometry><mesh filename="{file}" scale="{scale} {scale} {scale}"/></geometry>
</collision></link></robot>"""
FORMATS = {"sdf": SDF, "xml": MJCF, "urdf": URDF}
ALONG_Z = RigidTransform([0.0, 0.0, 0.1])
ALONG_Y = RigidTransform(RotationMatrix.MakeXRotation(np.pi / 2), [0.0, 0.0, 0.1])


def ring(unit: float = 1.0) -> trimesh.Trimesh:
    """A flat ring about the z axis, with an opening of 40 mm in a `unit` of metres."""
    return trimesh.creation.annulus(r_min=0.02 / unit, r_max=0.03 / unit, height=0.01 / unit)


class Scene:
    """A model with one collision mesh."""

    def __init__(self, folder: Path, mesh: trimesh.Trimesh, *, kind: str = "sdf", scale: float = 1):
        file = "grip.gltf" if kind == "gltf" else "grip.obj"
        mesh.export(folder / file)
        kind = "sdf" if kind == "gltf" else kind
        self.builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(self.builder, time_step=0.01)
        (folder / f"cup.{kind}").write_text(FORMATS[kind].format(file=file, scale=scale))
        Parser(self.plant).AddModels(str(folder / f"cup.{kind}"))

    def replace(self, collision: str | None) -> None:
        ReplaceConcaveMeshes(self.plant, self.scene_graph, PoilConfig(collision=collision))

    def num_pieces(self) -> int:
        inspector = self.scene_graph.model_inspector()
        return len(CollisionGeometries(self.plant, inspector, "cup", "gri."))

    def distances(self, X_WB: RigidTransform) -> list[float]:
        """Returns the distances between the pieces and a rod of 20 mm by 20 mm by 100 mm."""
        plant, scene_graph = self.plant, self.scene_graph
        rod = plant.RegisterCollisionGeometry(
            plant.world_body(), X_WB, Box(0.02, 0.02, 0.1), "rod", CoulombFriction(1, 1)
        )
        plant.Finalize()
        context = self.builder.Build().CreateDefaultContext()
        query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
        pieces = CollisionGeometries(plant, scene_graph.model_inspector(), "cup", "grip")
        return [query.ComputeSignedDistancePairClosestPoints(p.id, rod).distance for p in pieces]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.parametrize(("kind", "unit"), [("sdf", 1.0), ("xml", 1e-3), ("urdf", 1e-3)])
def test_a_concave_mesh_is_refused(kind: str, unit: float, tmp_path: Path) -> None:
    dut = Scene(tmp_path, ring(unit), kind=kind, scale=unit)

    # The middle of the opening is 20 mm away from the ring; random points are a little nearer.
    says = r"grip\.obj' of 'cup::handle' is concave: .* up to (1\d|20) mm away"
    with pytest.raises(ScenarioError, match=says):
        dut.replace(None)


def test_a_cup_with_a_thin_wall_is_refused(tmp_path: Path) -> None:
    profile = [(0, 0), (0.04, 0), (0.04, 0.1), (0.039, 0.1), (0.039, 0.001), (0, 0.001)]
    dut = Scene(tmp_path, trimesh.creation.revolve(np.array(profile)))

    with pytest.raises(ScenarioError, match=r"is concave: .* up to 3\d mm away"):
        dut.replace(None)


def test_flat_and_large_meshes_are_accepted(tmp_path: Path) -> None:
    Scene(tmp_path, trimesh.creation.box((3.0, 2.0, 0.001))).replace(None)


@pytest.mark.parametrize("depth", [0.0, 0.001])
def test_convex_meshes_and_shallow_dents_are_accepted(depth: float, tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.1, 0.1, 0.1)).subdivide()
    top = mesh.vertices[:, 2] > 0.0499
    mesh.vertices[top & (np.abs(mesh.vertices[:, :2]).max(axis=1) < 0.01), 2] -= depth

    Scene(tmp_path, mesh).replace(None)


def test_the_filled_shape_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "coacd", None)  # Importing it fails.
    dut = Scene(tmp_path, ring())

    dut.replace("hull")

    assert dut.num_pieces() == 1
    assert min(dut.distances(ALONG_Z)) < -0.01


def test_a_decomposed_ring_is_open(tmp_path: Path) -> None:
    dut = Scene(tmp_path, ring(unit=1e-3), kind="urdf", scale=1e-3)

    dut.replace("decompose")

    assert dut.num_pieces() > 3
    # The rod's edges are sqrt(2) * 10 mm from the axis, its faces 10 mm.
    assert 0.004 < min(dut.distances(ALONG_Z)) < 0.011


def test_gltf_is_read_with_y_up_as_drake_does(tmp_path: Path) -> None:
    dut = Scene(tmp_path, ring(), kind="gltf")

    dut.replace("decompose")

    # What was z of the file is -y of the model.
    assert min(dut.distances(ALONG_Y)) > 0.004


def test_pieces_are_computed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Scene(tmp_path, ring()).replace("decompose")
    monkeypatch.setitem(sys.modules, "coacd", None)

    Scene(tmp_path, ring()).replace("decompose")

    with pytest.raises(MissingDependencyError, match="pip install coacd"):
        Scene(tmp_path, ring().apply_scale(1.1)).replace("decompose")


def test_an_unknown_choice_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"poil\.collision is 'fill'.*'decompose' or 'hull'"):
        PoilConfig(collision="fill")

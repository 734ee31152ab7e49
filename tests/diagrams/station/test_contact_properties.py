"""Objects whose files state no contact properties stand still, and are held."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from bare_mugs import WALL, body_radius, write_bare_mug
from pydrake.geometry import Role
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.solvers import Solve
from pydrake.systems.analysis import Simulator
from station_state import GetObjectPose, SetObjectPose, SetRobotPosition

from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.scenario.randomization import ObjectDirective
from poil_drake.diagrams.station.station import MakeStation, Station
from poil_drake.errors import ScenarioError

START = RigidTransform([0.45, -0.10, 0.0])


def station_with(model: Path, data: str = "{}") -> Station:
    """Returns the package's scene with another model file as the mug, and YAML merged over it."""
    scenario = ChooseScenario(data="{poil: {parts: {handle: '(grip|handle)_.*'}}}")
    directive = ObjectDirective(list(scenario.directives), "mug")
    directive.file = f"file://{model}"
    directive.default_free_body_pose = {}
    blind = dataclasses.replace(scenario, cameras={})
    return MakeStation(LoadScenario(data=data, defaults=blind), cameras=False)


CUP = """<mujoco model="cup"><worldbody><body name="cup"><freejoint/>
<geom name="bowl" {geom} mass="0.2"/>
<geom name="grip_0" type="box" size="0.005 0.005 0.01" pos="0.07 0 0.045" mass="0.01"/>
</body></worldbody></mujoco>"""

PAN = """<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="pan"><link name="pan">
<inertial><mass>0.2</mass><inertia><ixx>2e-4</ixx><iyy>2e-4</iyy><izz>2e-4</izz></inertia></inertial>
<visual name="grip_0"><geometry><box><size>0.01 0.01 0.1</size></box></geometry></visual>
<collision name="bare">
<geometry><cylinder><radius>0.04</radius><length>0.02</length></cylinder></geometry></collision>
<collision name="stated">
<geometry><cylinder><radius>0.04</radius><length>0.02</length></cylinder></geometry>
<drake:proximity_properties><drake:rigid_hydroelastic/>
<drake:mesh_resolution_hint>0.02</drake:mesh_resolution_hint></drake:proximity_properties>
</collision></link></model></sdf>"""


def elements(station: Station) -> dict[str, int]:
    """Returns the number of elements of each geometry's hydroelastic mesh, by its name."""
    query = station.GetOutputPort("query_object").Eval(station.CreateDefaultContext())
    inspector = query.inspector()
    meshes = {
        inspector.GetName(g): inspector.maybe_get_hydroelastic_mesh(g)
        for g in inspector.GetAllGeometryIds(Role.kProximity)
    }
    return {name: mesh.num_elements() for name, mesh in meshes.items() if mesh is not None}


@pytest.mark.parametrize(
    ("shapes", "height"), [("boxes", 0.09), ("capsules", 0.06), ("meshes", 0.14)]
)
def test_a_mug_without_contact_properties_is_held_by_its_rim(
    shapes: str, height: float, tmp_path: Path
) -> None:
    model = write_bare_mug(tmp_path, shapes=shapes, height=height)
    station = station_with(model, "{poil: {collision: hull}}")
    simulator = Simulator(station)
    context, plant = simulator.get_mutable_context(), station.plant()
    frame = plant.GetFrameByName("panda_hand_tcp")
    SetObjectPose(station, context, START)
    # From above, at the wall opposite the handle; the pads reach 12 mm below the rim.
    rim = [0.45 - body_radius(height) + WALL / 2, -0.10, height - 0.003]
    ik = InverseKinematics(plant, with_joint_limits=True)
    down = RotationMatrix(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]).T)
    ik.AddPositionConstraint(frame, np.zeros(3), plant.world_frame(), rim, rim)
    ik.AddOrientationConstraint(plant.world_frame(), down, frame, RotationMatrix(), 1e-3)
    ik.prog().SetInitialGuess(ik.q(), plant.GetPositions(plant.CreateDefaultContext()))
    SetRobotPosition(station, context, Solve(ik.prog()).GetSolution(ik.q())[:7], width=0.02)
    station.GetInputPort("hand.width").FixValue(context, [0.0])

    def pose_in_hand() -> RigidTransform:
        X_WG = frame.CalcPoseInWorld(plant.GetMyContextFromRoot(context))
        return X_WG.InvertAndCompose(GetObjectPose(station, context))

    simulator.AdvanceTo(0.5)
    width = station.GetOutputPort("hand.width_measured").Eval(context)[0]
    before = pose_in_hand()
    shoulder = np.eye(7)[1]
    station.GetInputPort("panda.velocity").FixValue(context, -0.3 * shoulder)
    simulator.AdvanceTo(2.0)

    assert width > WALL - 0.001
    assert GetObjectPose(station, context).translation()[2] > 0.1
    slip = before.InvertAndCompose(pose_in_hand())
    assert np.linalg.norm(slip.translation()) < 0.003
    assert np.degrees(slip.rotation().ToAngleAxis().angle()) < 3.0


@pytest.mark.parametrize(
    "geom",
    [
        'type="cylinder" size="0.04 0.045" pos="0 0 0.045"',
        'type="box" size="0.04 0.03 0.045" pos="0 0 0.045"',
    ],
)
def test_an_object_stands_still(geom: str, tmp_path: Path) -> None:
    (tmp_path / "cup.xml").write_text(CUP.format(geom=geom))
    station = station_with(tmp_path / "cup.xml")
    simulator = Simulator(station)
    context, plant = simulator.get_mutable_context(), station.plant()
    SetObjectPose(station, context, RigidTransform([0.45, -0.10, 0.001]))

    simulator.AdvanceTo(1.0)

    for k in range(1, 9):
        simulator.AdvanceTo(1.0 + k / 32)
        V = station.object_body().EvalSpatialVelocityInWorld(plant.GetMyContextFromRoot(context))
        assert np.linalg.norm(V.translational()) < 1e-3


def test_only_what_is_not_stated_is_added(tmp_path: Path) -> None:
    (tmp_path / "pan.sdf").write_text(PAN)
    soft = "{scene_graph_config: {default_proximity_properties: {compliance_type: compliant}}}"

    rigid = elements(station_with(tmp_path / "pan.sdf"))
    dut = elements(station_with(tmp_path / "pan.sdf", soft))

    # 16 sides and two caps, each side of two triangles; the stated resolution gives 13 sides.
    assert rigid["mug::bare"] == 16 * 4
    assert rigid["mug::stated"] == 13 * 4
    # Inside, a compliant cylinder consists of tetrahedra.
    assert dut["mug::bare"] > rigid["mug::bare"]
    assert dut["mug::stated"] == rigid["mug::stated"]


def test_point_contact_can_be_chosen(tmp_path: Path) -> None:
    (tmp_path / "pan.sdf").write_text(PAN)

    dut = elements(station_with(tmp_path / "pan.sdf", "{plant_config: {contact_model: point}}"))

    assert "mug::bare" not in dut


def test_an_unknown_compliance_type_is_refused(tmp_path: Path) -> None:
    (tmp_path / "pan.sdf").write_text(PAN)
    soft = "{scene_graph_config: {default_proximity_properties: {compliance_type: soft}}}"

    with pytest.raises(ScenarioError, match=r"scene_graph_config .*'soft'.*rigid or comp"):
        station_with(tmp_path / "pan.sdf", soft)

"""The simulated physics: grips hold, and mugs stay where they hang."""

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.solvers import Solve
from pydrake.systems.analysis import Simulator
from station_state import GetObjectPose, SetObjectPose, SetRobotPosition

from poil_drake.diagrams.run.task_success import TouchedGeometries
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.randomization import ObjectDirective
from poil_drake.diagrams.station.station import MakeStation, Station
from poil_drake.models.mug_family import NAMED_MUGS, MugParameters
from poil_drake.models.mug_shape import handle_center_line

ROD_BASE = np.array([0.55, 0.30, 0.26])
ROD_SLOPE = np.deg2rad(15)
ROD_DIRECTION = np.array([0.0, -np.cos(ROD_SLOPE), np.sin(ROD_SLOPE)])
ROD_RADIUS = 0.0055
READY = np.array([0.0, -0.5, 0.0, -2.3, 0.0, 1.8, 0.785])
MUGS = {mug.name: mug for mug in NAMED_MUGS}


def make_simulator(mug: MugParameters) -> tuple[Station, Simulator]:
    scenario = ChooseScenario()
    model = ObjectDirective(list(scenario.directives), "mug")
    model.file = f"package://poil_drake/mugs/{mug.name}/{mug.name}.sdf"
    station = MakeStation(scenario, cameras=False)
    simulator = Simulator(station)
    simulator.Initialize()
    return station, simulator


def hanging_pose(mug: MugParameters, *, tilt: float, along: float) -> RigidTransform:
    """The handle 1 mm above the rod, `along` m from the post, the mug tilted by `tilt` rad."""
    R_WO = RotationMatrix.MakeYRotation(-tilt)
    line = handle_center_line(mug, 400) @ R_WO.matrix().T
    highest = line[np.argmax(line[:, 2])]
    below = mug.handle_radius + ROD_RADIUS / np.cos(ROD_SLOPE) - 0.001
    rod_in_handle = highest - [0.0, 0.0, below]
    return RigidTransform(R_WO, ROD_BASE + along * ROD_DIRECTION - rod_in_handle)


def touched(station: Station, simulator: Simulator) -> frozenset[str]:
    plant: MultibodyPlant = station.plant()
    scene_graph: SceneGraph = station.scene_graph()
    results = station.GetOutputPort("contact_results").Eval(simulator.get_context())
    geometries = TouchedGeometries(plant, scene_graph.model_inspector(), results, "mug")
    return frozenset(name.split("::")[0] for name in geometries)


@pytest.mark.parametrize("mug", NAMED_MUGS, ids=lambda mug: mug.name)
def test_a_mug_released_on_the_rod_stays(mug: MugParameters) -> None:
    station, simulator = make_simulator(mug)
    start = hanging_pose(mug, tilt=np.deg2rad(50), along=0.085)
    SetObjectPose(station, simulator.get_mutable_context(), start)

    seen: set[str] = set()
    for k in range(1, 33):
        simulator.AdvanceTo(k / 16)
        seen |= touched(station, simulator)

    end = GetObjectPose(station, simulator.get_context())
    assert seen == {"rack"}
    # It swings about the rod, but slides along it by less than the 55 mm left to the tip.
    assert abs(end.translation()[1] - start.translation()[1]) < 0.02
    assert end.translation()[2] > 0.15


def grasp_position(station: Station, X_WG: RigidTransform) -> np.ndarray:
    """Joint positions that bring the gripper frame to X_WG, found by Drake's own solver."""
    plant = station.plant()
    ik = InverseKinematics(plant, with_joint_limits=True)
    frame = plant.GetFrameByName("panda_hand_tcp")
    p = X_WG.translation()
    ik.AddPositionConstraint(frame, np.zeros(3), plant.world_frame(), p - 1e-4, p + 1e-4)
    ik.AddOrientationConstraint(plant.world_frame(), X_WG.rotation(), frame, RotationMatrix(), 1e-3)
    start = plant.GetPositions(plant.CreateDefaultContext())
    start[:7] = READY
    ik.prog().AddQuadraticErrorCost(np.eye(len(start)), start, ik.q())
    ik.prog().SetInitialGuess(ik.q(), start)
    result = Solve(ik.prog())
    assert result.is_success()
    return result.GetSolution(ik.q())[:7]


def grasp_rim(
    mug: MugParameters, station: Station, simulator: Simulator, *, width: float
) -> np.ndarray:
    """Closes the hand from an opening [m]; returns the grasped point in the mug's frame.

    The hand grasps the wall opposite the handle from above. The pads end 9 mm below the gripper
    frame, and reach 12 mm below the rim.
    """
    context = simulator.get_mutable_context()
    p_WO = np.array([0.45, -0.10, 0.0])
    SetObjectPose(station, context, RigidTransform(p_WO))
    p_OG = np.array([-(mug.radius - mug.wall / 2), 0.0, mug.height - 0.003])
    R_WG = RotationMatrix(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]).T)
    q = grasp_position(station, RigidTransform(R_WG, p_WO + p_OG))
    SetRobotPosition(station, context, q, width=width)
    station.GetInputPort("hand.width").FixValue(context, [0.0])
    simulator.AdvanceTo(0.5)
    return p_OG


def drive(station: Station, simulator: Simulator, V_WG: np.ndarray, duration: float) -> None:
    plant, context = station.plant(), simulator.get_mutable_context()
    frame, world = plant.GetFrameByName("panda_hand_tcp"), plant.world_frame()
    for _ in range(round(duration * 128)):
        J = plant.CalcJacobianSpatialVelocity(
            plant.GetMyContextFromRoot(context),
            JacobianWrtVariable.kV,
            frame,
            np.zeros(3),
            world,
            world,
        )[:, :7]
        station.GetInputPort("panda.velocity").FixValue(context, np.linalg.pinv(J) @ V_WG)
        simulator.AdvanceTo(context.get_time() + 1 / 128)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mug_a", "mug_e"])
def test_pads_hold_a_mug_by_its_rim(name: str) -> None:
    mug = MUGS[name]
    station, simulator = make_simulator(mug)
    context = simulator.get_mutable_context()
    plant = station.plant()
    frame = plant.GetFrameByName("panda_hand_tcp")
    p_OG = grasp_rim(mug, station, simulator, width=0.02)

    def grip_in_hand() -> tuple[np.ndarray, RotationMatrix]:
        X_WG = frame.CalcPoseInWorld(plant.GetMyContextFromRoot(context))
        X_GO = X_WG.InvertAndCompose(GetObjectPose(station, context))
        return X_GO @ p_OG, X_GO.rotation()

    # Once lifted off the table, a tapered wall may settle flat against the pads.
    drive(station, simulator, np.array([0.0, 0, 0, 0, 0, 0.15]), 0.5)
    point, rotation = grip_in_hand()
    drive(station, simulator, np.array([0.0, -0.7, 0, 0, 0.1, 0.05]), 1.0)
    drive(station, simulator, np.zeros(6), 0.5)
    later, rotation_later = grip_in_hand()

    assert np.linalg.norm(later - point) < 2e-3
    turned = (rotation.inverse() @ rotation_later).ToAngleAxis().angle()
    assert np.rad2deg(turned) < 2.0
    assert touched(station, simulator) == {"panda"}
    # The mug's weight loads the joints, with a lever arm of about half a metre.
    weight = mug.mass * 9.81
    torque = station.GetOutputPort("panda.torque_external").Eval(context)
    assert 0.1 * weight < np.linalg.norm(torque) < 1.0 * weight


def test_the_grip_force_is_limited() -> None:
    mug = MUGS["mug_a"]
    station, simulator = make_simulator(mug)
    context = simulator.get_mutable_context()

    grasp_rim(mug, station, simulator, width=0.01)

    results = station.GetOutputPort("contact_results").Eval(context)
    forces = [
        abs(results.hydroelastic_contact_info(i).F_Ac_W().translational()[0])
        for i in range(results.num_hydroelastic_contacts())
    ]
    # Both pads together press with twice the 60 N of each.
    assert sum(forces) == pytest.approx(120, rel=0.1)
    # The pads hold the wall of 3.5 mm, squeezed by less than half a millimetre.
    width = station.GetOutputPort("hand.width_measured").Eval(context)[0]
    assert 0.0030 < width < 0.0036

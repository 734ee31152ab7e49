"""The station: a robot, its cameras and its surroundings behind named ports."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.lcm import ApplyLcmBusConfig
from pydrake.systems.sensors import RgbdSensor
from pydrake.visualization import ApplyVisualizationConfig

from poil_drake.diagrams.cameras import AddCameras, MakeFrame, ReadImage, SensorCameraModel
from poil_drake.diagrams.labels import AssignLabels
from poil_drake.diagrams.panda_arm import (
    ARM_DRIVER,
    HAND_DRIVER,
    AddPandaDrivers,
    SetControllerGains,
)
from poil_drake.diagrams.scenario import Scenario
from poil_drake.diagrams.scenario_fit import CheckScenarioFits
from poil_drake.diagrams.scenario_models import (
    AddModels,
    AddPackages,
    AddScenarioPlant,
    RequireModel,
    SetInitialPositions,
)
from poil_drake.errors import StationError
from poil_drake.models.panda_model import BASE_LINK
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.systems.panda_velocity_driver import PandaDriver

PrefinalizeCallback = Callable[[Parser], None]


class Station(Diagram):
    """A simulated station, built by `MakeStation`.

    .. pydrake_system::

        name: Station
        input_ports:
        - panda.velocity
        - panda.velocity_time
        - hand.width
        - applied_spatial_force
        output_ports:
        - panda.position_measured
        - panda.velocity_measured
        - panda.torque_external
        - panda.status
        - hand.width_measured
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.label_image
        - body_poses
        - query_object
        - contact_results

    All inputs may be left unconnected: the arm and hand then hold still. Joint vectors are (7,),
    [rad], [rad/s], [N m]; `panda.torque_external` is what contacts do to the joints. `hand.width`
    is [m]. `panda` stands for the robot's name in the scenario.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        meshcat: Meshcat | None,
        cameras: bool,
        package_xmls: Sequence[str | Path],
        parser_preload_callback: PrefinalizeCallback | None,
        parser_prefinalize_callback: PrefinalizeCallback | None,
    ):
        super().__init__()
        builder = DiagramBuilder()
        poil = scenario.poil
        self._scenario = scenario
        self._sensors: dict[str, RgbdSensor] = {}
        self._plant, self._scene_graph = AddScenarioPlant(builder, scenario)
        parser = Parser(self._plant)
        AddPackages(parser, package_xmls)
        if parser_preload_callback is not None:
            parser_preload_callback(parser)
        AddModels(parser, scenario.directives)
        for role, name in (("robot", poil.robot), ("object", poil.object)):
            RequireModel(self._plant, name, role)
        robot = self._plant.GetModelInstanceByName(poil.robot)
        driver = scenario.model_drivers.get(poil.robot, PandaDriver())
        SetControllerGains(plant=self._plant, robot=robot, config=driver)
        SetInitialPositions(self._plant, scenario)
        self._label_ids = AssignLabels(
            plant=self._plant,
            scene_graph=self._scene_graph,
            parts={poil.object: {poil.part: poil.part, **poil.parts}},
        )
        if parser_prefinalize_callback is not None:
            parser_prefinalize_callback(parser)
        self._plant.Finalize()
        CheckScenarioFits(self._plant, scenario)
        lcm_buses = ApplyLcmBusConfig(dict(scenario.lcm_buses), builder)
        AddPandaDrivers(
            builder=builder,
            plant=self._plant,
            robot=robot,
            config=driver,
            time_step=poil.rates.plant,
        )
        if cameras:
            self._sensors = AddCameras(
                builder=builder,
                plant=self._plant,
                cameras=scenario.cameras,
                lcm_buses=lcm_buses,
                noise=poil.depth_noise,
                seed=scenario.random_seed,
            )
        if meshcat is not None:
            ApplyVisualizationConfig(
                scenario.visualization, builder, lcm_buses=lcm_buses, meshcat=meshcat
            )
        builder.ExportInput(
            self._plant.get_applied_spatial_force_input_port(), "applied_spatial_force"
        )
        builder.ExportOutput(self._plant.get_body_poses_output_port(), "body_poses")
        builder.ExportOutput(self._plant.get_contact_results_output_port(), "contact_results")
        builder.ExportOutput(self._scene_graph.get_query_output_port(), "query_object")
        builder.BuildInto(self)

    @property
    def scenario(self) -> Scenario:
        """What the station was built from."""
        return self._scenario

    @property
    def label_ids(self) -> Mapping[str, tuple[int, ...]]:
        """Which render labels stand for what: "mug", "mug/handle", "rack", ..."""
        return self._label_ids

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The names of the cameras; empty when the station was built without."""
        return tuple(self._sensors)

    def plant(self) -> MultibodyPlant:
        """Returns the simulated plant."""
        return self._plant

    def scene_graph(self) -> SceneGraph:
        """Returns the plant's scene graph."""
        return self._scene_graph

    def object_body(self) -> RigidBody:
        """Returns the object's base body, whose frame is the object's frame O."""
        instance = self._plant.GetModelInstanceByName(self._scenario.poil.object)
        return self._plant.get_body(self._plant.GetBodyIndices(instance)[0])

    def robot_base_pose(self) -> RigidTransform:
        """Returns X_WB, the pose of the robot's base, which does not move."""
        plant = self._plant
        robot = plant.GetModelInstanceByName(self._scenario.poil.robot)
        return plant.GetBodyByName(BASE_LINK, robot).EvalPoseInWorld(plant.CreateDefaultContext())

    def camera_models(self, context: Context) -> tuple[CameraModel, ...]:
        """Returns the cameras' models, at the poses that they have in the station's context."""
        return tuple(
            SensorCameraModel(diagram=self, context=context, name=name, sensor=sensor)
            for name, sensor in self._sensors.items()
        )


def MakeStation(
    scenario: Scenario,
    *,
    meshcat: Meshcat | None = None,
    hardware: bool = False,
    cameras: bool = True,
    package_xmls: Sequence[str | Path] = (),
    parser_preload_callback: PrefinalizeCallback | None = None,
    parser_prefinalize_callback: PrefinalizeCallback | None = None,
) -> Station:
    """Builds the station of a scenario.

    Args:
        scenario: What stands where, and how it behaves.
        meshcat: Shows the scene there.
        hardware: Not available yet; there is a simulated station only.
        cameras: False leaves out cameras and renderer altogether, for speed.
        package_xmls: Further `package.xml` files, for directives with `package://...`.
        parser_preload_callback: Called with the parser before the directives are read.
        parser_prefinalize_callback: Called with the parser before the plant is finalized.

    Raises:
        ScenarioError: when the scenario does not fit together.
        StationError: when the station cannot be built.
        MissingDependencyError: when the Panda's description is not installed.
    """
    if hardware:
        raise StationError(
            "There is no station for real hardware yet, only the simulated one.",
            remedy="Leave out hardware (--hardware).",
        )
    return Station(
        scenario,
        meshcat=meshcat,
        cameras=cameras,
        package_xmls=package_xmls,
        parser_preload_callback=parser_preload_callback,
        parser_prefinalize_callback=parser_prefinalize_callback,
    )


def CaptureFrame(station: Station, context: Context, *, labels: bool = False) -> MultiViewFrame:
    """Takes a picture with every camera now.

    Args:
        station: The station.
        context: The station's own context, not that of a diagram around it.
        labels: Whether to render the label images, too. They cost as much as the others.

    Raises:
        StationError: when the station has no cameras.
    """
    if not station.camera_names:
        raise StationError(
            "The station has no cameras.",
            remedy="Name cameras in the scenario and build the station with cameras=True.",
        )
    images = tuple(
        ReadImage(diagram=station, context=context, name=name, labels=labels)
        for name in station.camera_names
    )
    return MakeFrame(station.camera_models(context), images, station.label_ids)


def GetObjectPose(station: Station, context: Context) -> RigidTransform:
    """Returns X_WO, the pose of the object's base body, from the station's context."""
    plant_context = station.GetSubsystemContext(station.plant(), context)
    return station.object_body().EvalPoseInWorld(plant_context)


def SetObjectPose(station: Station, context: Context, X_WO: RigidTransform) -> None:
    """Puts the object's base body at X_WO, at rest, in the station's context."""
    plant, body = station.plant(), station.object_body()
    plant_context = station.GetMutableSubsystemContext(plant, context)
    plant.SetFreeBodyPose(plant_context, body, X_WO)
    plant.SetVelocities(
        plant_context,
        body.model_instance(),
        np.zeros(plant.num_velocities(body.model_instance())),
    )


def SetRobotPosition(
    station: Station, context: Context, q: np.ndarray, *, width: float | None = None
) -> None:
    """Puts the arm at joint positions q (7,) [rad] and the hand at a width [m], at rest.

    The drivers are reset, too, so that the robot stays there.
    """
    plant = station.plant()
    robot = plant.GetModelInstanceByName(station.scenario.poil.robot)
    plant_context = station.GetMutableSubsystemContext(plant, context)
    positions = plant.GetPositions(plant_context, robot)
    positions[: len(q)] = q
    if width is not None:
        positions[len(q) :] = width / 2
    plant.SetPositions(plant_context, robot, positions)
    plant.SetVelocities(plant_context, robot, np.zeros(plant.num_velocities(robot)))
    for name in (ARM_DRIVER, HAND_DRIVER):
        driver = station.GetSubsystemByName(name)
        driver.Reset(station.GetMutableSubsystemContext(driver, context))

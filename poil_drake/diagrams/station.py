"""The station: a robot, its cameras and its surroundings behind named ports."""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pydrake.geometry import Meshcat, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.lcm import ApplyLcmBusConfig, LcmBuses
from pydrake.visualization import ApplyVisualizationConfig

from poil_drake.diagrams.camera_process import CameraProcess
from poil_drake.diagrams.cameras import (
    AddCameras,
    AddDelayedCameras,
    CameraDelay,
    MakeFrame,
    ReadImage,
)
from poil_drake.diagrams.labels import AssignLabels
from poil_drake.diagrams.panda_arm import (
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
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.systems.delayed_cameras import DelayedCameras
from poil_drake.systems.panda_velocity_driver import PandaDriver
from poil_drake.systems.stopwatch import Stopwatch

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
        - <camera>.image_time
        - body_poses
        - query_object
        - contact_results

    All inputs may be left unconnected: the arm and hand then hold still. Joint vectors are (7,),
    [rad], [rad/s], [N m]; `panda.torque_external` is what contacts do to the joints. `hand.width`
    is [m]. `panda` stands for the robot's name in the scenario.

    Images are of the moment when somebody looks, and rendered then, unless the cameras have an
    `output_delay`. With one they are captured at the tracker's rate, rendered by a process of
    their own, and appear that much later; before the first they are empty (see `DelayedCameras`).
    That process knows the plant's positions only (see `CameraProcess`). It starts with the first
    capture, or with `StartCameras`; `WarmUpCameras` waits until it is ready, and `Close` ends it.
    `<camera>.image_time` (1,) is the time of the capture [s].
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        meshcat: Meshcat | None,
        cameras: bool,
        ignore_output_delay: bool,
        package_xmls: Sequence[str | Path],
        stopwatch: Stopwatch | None,
        parser_preload_callback: PrefinalizeCallback | None,
        parser_prefinalize_callback: PrefinalizeCallback | None,
    ):
        super().__init__()
        builder = DiagramBuilder()
        poil = scenario.poil
        self._scenario = scenario
        self._camera_models: tuple[CameraModel, ...] = ()
        self._camera_process: CameraProcess | None = None
        self._delayed_cameras: DelayedCameras | None = None
        self._camera_delay = 0.0
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
        CheckScenarioFits(self._plant, self._scene_graph.model_inspector(), scenario)
        lcm_buses = ApplyLcmBusConfig(dict(scenario.lcm_buses), builder)
        AddPandaDrivers(
            builder=builder,
            plant=self._plant,
            robot=robot,
            config=driver,
            time_step=poil.rates.plant,
        )
        if cameras:
            self._add_cameras(builder, lcm_buses, ignore_output_delay, package_xmls, stopwatch)
        # Before the visualization: in newer Drakes it takes the port for dragging with the mouse.
        builder.ExportInput(
            self._plant.get_applied_spatial_force_input_port(), "applied_spatial_force"
        )
        if meshcat is not None:
            visualization = copy.copy(scenario.visualization)
            if hasattr(visualization, "mouse_interaction_stiffness"):
                visualization.mouse_interaction_stiffness = None
            ApplyVisualizationConfig(visualization, builder, lcm_buses=lcm_buses, meshcat=meshcat)
        builder.ExportOutput(self._plant.get_body_poses_output_port(), "body_poses")
        builder.ExportOutput(self._plant.get_contact_results_output_port(), "contact_results")
        builder.ExportOutput(self._scene_graph.get_query_output_port(), "query_object")
        builder.BuildInto(self)

    def _add_cameras(
        self,
        builder: DiagramBuilder,
        lcm_buses: LcmBuses,
        ignore_output_delay: bool,
        package_xmls: Sequence[str | Path],
        stopwatch: Stopwatch | None,
    ) -> None:
        scenario = self._scenario
        delay = CameraDelay(scenario.cameras)
        if ignore_output_delay or delay == 0.0:
            self._camera_models = AddCameras(
                builder=builder,
                plant=self._plant,
                cameras=scenario.cameras,
                lcm_buses=lcm_buses,
                noise=scenario.poil.depth_noise,
                seed=scenario.random_seed,
            )
            return
        self._camera_delay = delay
        self._camera_process = CameraProcess(scenario, package_xmls)
        self._delayed_cameras = AddDelayedCameras(
            builder=builder,
            plant=self._plant,
            cameras=scenario.cameras,
            lcm_buses=lcm_buses,
            renderer=self._camera_process,
            period=scenario.poil.rates.tracker,
            stopwatch=stopwatch,
        )
        self._camera_models = self._delayed_cameras.cameras

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
        return tuple(camera.name for camera in self._camera_models)

    @property
    def camera_models(self) -> tuple[CameraModel, ...]:
        """The cameras' models; they do not move."""
        return self._camera_models

    @property
    def camera_delay(self) -> float:
        """From the capture of the exported images to their appearance [s]."""
        return self._camera_delay

    def RenderImages(self, context: Context, *, labels: bool = False) -> tuple[RgbdImage, ...]:
        """Returns what each camera sees now, (H, W) each; `CaptureFrame` makes a frame of it.

        Args:
            context: The station's own context.
            labels: Whether to render the label images, too.

        Raises:
            StationError: if the process that renders has ended.
        """
        if self._camera_process is None:
            return tuple(
                ReadImage(diagram=self, context=context, name=name, labels=labels)
                for name in self.camera_names
            )
        plant_context = self.GetSubsystemContext(self._plant, context)
        scene = (self._plant.GetPositions(plant_context), context.get_time())
        images = self._camera_process.render(*scene)
        if labels:
            found = self._camera_process.render_labels(*scene)
            images = tuple(replace(i, label=n) for i, n in zip(images, found, strict=True))
        return images

    def StartCameras(self) -> None:
        """Starts the process that renders for delayed cameras, early, without waiting for it."""
        if self._camera_process is not None:
            self._camera_process.start()

    def WarmUpCameras(self) -> None:
        """Waits until delayed cameras are ready to render at their usual pace.

        Raises:
            PoilError: if they cannot be used.
        """
        if self._camera_process is not None:
            self._camera_process.warm_up()

    def Close(self) -> None:
        """Ends the process of delayed cameras. Nothing can be simulated after that."""
        if self._camera_process is not None and self._delayed_cameras is not None:
            # First the thread that asks, then the process that answers.
            self._delayed_cameras.close()
            self._camera_process.close()

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


def MakeStation(
    scenario: Scenario,
    *,
    meshcat: Meshcat | None = None,
    hardware: bool = False,
    cameras: bool = True,
    ignore_output_delay: bool = False,
    package_xmls: Sequence[str | Path] = (),
    stopwatch: Stopwatch | None = None,
    parser_preload_callback: PrefinalizeCallback | None = None,
    parser_prefinalize_callback: PrefinalizeCallback | None = None,
) -> Station:
    """Builds the station of a scenario.

    Args:
        scenario: What stands where, and how it behaves.
        meshcat: Shows the scene there.
        hardware: Not available yet; there is a simulated station only.
        cameras: False leaves out cameras and renderer altogether, for speed.
        ignore_output_delay: Whether images are of the moment, whatever the cameras' `output_delay`:
            for a look around without a simulation.
        package_xmls: Further `package.xml` files, for directives with `package://...`.
        stopwatch: Where delayed cameras note how long they render, and are waited for.
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
    callbacks = (parser_preload_callback, parser_prefinalize_callback)
    if cameras and not ignore_output_delay and any(callbacks) and CameraDelay(scenario.cameras):
        raise StationError(
            "A station whose cameras have an output_delay got a parser callback, of which the "
            "process that renders would not know.",
            remedy="Set the cameras' output_delay to 0, or use ignore_output_delay=True.",
        )
    return Station(
        scenario,
        meshcat=meshcat,
        cameras=cameras,
        ignore_output_delay=ignore_output_delay,
        package_xmls=package_xmls,
        stopwatch=stopwatch,
        parser_preload_callback=parser_preload_callback,
        parser_prefinalize_callback=parser_prefinalize_callback,
    )


def CaptureFrame(station: Station, context: Context, *, labels: bool = False) -> MultiViewFrame:
    """Takes a picture with every camera now, whether they delay their images or not.

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
    return MakeFrame(
        station.camera_models, station.RenderImages(context, labels=labels), station.label_ids
    )

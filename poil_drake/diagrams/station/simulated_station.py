"""The simulated station."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.lcm import ApplyLcmBusConfig, LcmBuses
from pydrake.visualization import ApplyVisualizationConfig

from poil_drake.diagrams.scenario.model_checks import RequireMass, RequireObjectInertia
from poil_drake.diagrams.scenario.model_parts import BaseBody
from poil_drake.diagrams.scenario.models import AddScenarioPlant
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.diagrams.station.cameras.camera_process import CameraProcess
from poil_drake.diagrams.station.cameras.cameras import (
    AddCameras,
    CameraDelay,
    CheckCameras,
    MakeCameraModels,
)
from poil_drake.diagrams.station.cameras.faults import CheckFaults, MakeFaultInjector
from poil_drake.diagrams.station.contact_properties import ApplySceneGraphConfig
from poil_drake.diagrams.station.panda_arm import AddPandaDrivers
from poil_drake.diagrams.station.station_base import ExportOutputs, Station
from poil_drake.diagrams.station.station_models import AddStationModels, PrefinalizeCallback
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.faults.extrinsics import miscalibrated
from poil_drake.perception.images import MultiViewFrame, RgbdImage, by_name
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.cameras.camera_ports import copied_image
from poil_drake.systems.cameras.delayed_cameras import DelayedCameras, SceneRenderer
from poil_drake.systems.cameras.faulty_renderer import FaultyRenderer
from poil_drake.systems.capture_timing import SimulatedDelay
from poil_drake.systems.tracking.ground_truth_tracker import (
    GroundTruthTracker,
    GroundTruthTrackerConfig,
)


class SimulatedStation(Station):
    """A simulated robot and its surroundings, built by `MakeStation`.

    .. pydrake_system::

        name: SimulatedStation
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
        - <camera>.rgbd_image
        - <camera>.label_image
        - <camera>.image_time
        - body_poses
        - query_object
        - contact_results
        - plant_state

    All inputs are optional. Without them, the arm and the hand hold still. Joint vectors are (7,),
    in [rad], [rad/s] or [N m]; `panda.torque_external` holds the joint torques due to contacts.
    `panda.velocity_time` (1,) is the stamp of the command [s] (see `PandaVelocityDriver`).
    `hand.width` (1,) is in [m]. `panda` stands for the robot's name in the scenario.

    Images are rendered when their ports are evaluated, unless the cameras have an `output_delay`.
    In that case, images are captured at the tracker's rate, rendered by a separate process, and
    appear `output_delay` after the capture. Until the first image appears, the ports hold empty
    images (see `DelayedCameras`). The process receives only the plant's positions (see
    `CameraProcess`). The process starts with the first capture, or with `Start`; `WarmUp` waits
    until it is ready, and `Close` ends it. `<camera>.image_time` (1,) is the capture time [s].
    `<camera>.rgbd_image` exists only for cameras with an `output_delay`.
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
        self.scenario = scenario
        self._camera_process: CameraProcess | None = None
        self._delayed_cameras: DelayedCameras | None = None
        self._plant, self._scene_graph = AddScenarioPlant(builder, scenario)
        self.label_ids = AddStationModels(
            plant=self._plant,
            scene_graph=self._scene_graph,
            scenario=scenario,
            package_xmls=package_xmls,
            parser_preload_callback=parser_preload_callback,
            parser_prefinalize_callback=parser_prefinalize_callback,
        )
        RequireMass(self._plant)
        RequireObjectInertia(self._plant, self._scene_graph.model_inspector(), poil.object)
        ApplySceneGraphConfig(self._plant, self._scene_graph, scenario)
        lcm_buses = ApplyLcmBusConfig(dict(scenario.lcm_buses), builder)
        AddPandaDrivers(builder=builder, plant=self._plant, scenario=scenario)
        offset = 0.0
        if cameras:
            offset = self._add_cameras(
                builder, lcm_buses, ignore_output_delay, package_xmls, stopwatch
            )
        self.detector_timing = SimulatedDelay(period=poil.rates.tracker, offset=offset, latency=0.0)
        # `poil.latency` counts from the capture of the images.
        latency = max(poil.latency - offset, 0.0)
        self.tracker_timing = replace(self.detector_timing, latency=latency)
        # Before the visualization, which in newer versions of Drake uses this port for dragging.
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
        builder.ExportOutput(self._plant.get_state_output_port(), "plant_state")
        builder.BuildInto(self)

    def _add_cameras(
        self,
        builder: DiagramBuilder,
        lcm_buses: LcmBuses,
        ignore_output_delay: bool,
        package_xmls: Sequence[str | Path],
        stopwatch: Stopwatch | None,
    ) -> float:
        """Adds the cameras; returns the time at which perception first captures images [s]."""
        scenario = self.scenario
        faults = scenario.poil.faults
        delay = CameraDelay(scenario.cameras)
        CheckFaults(scenario, delayed=ignore_output_delay or delay > 0.0)
        if ignore_output_delay or delay == 0.0:
            models = AddCameras(
                builder=builder,
                plant=self._plant,
                scenario=scenario,
                lcm_buses=lcm_buses,
            )
            self.camera_models = miscalibrated(models, faults)
            return 0.0
        models = MakeCameraModels(self._plant, scenario.cameras)
        self.camera_models = miscalibrated(models, faults)
        CheckCameras(scenario.cameras, lcm_buses)
        self._camera_process = CameraProcess(scenario, package_xmls)
        renderer: SceneRenderer = self._camera_process
        if faults:
            renderer = FaultyRenderer(
                renderer,
                injector=MakeFaultInjector(scenario),
                cameras=models,
                label_ids=self.label_ids,
            )
        self._delayed_cameras = builder.AddNamedSystem(
            "cameras",
            DelayedCameras(
                renderer=renderer,
                cameras=self.camera_models,
                num_positions=self._plant.num_positions(),
                num_velocities=self._plant.num_velocities(),
                period=scenario.poil.rates.tracker,
                delay=delay,
                stopwatch=stopwatch,
            ),
        )
        builder.Connect(
            self._plant.get_state_output_port(), self._delayed_cameras.GetInputPort("plant_state")
        )
        ExportOutputs(builder, self._delayed_cameras)
        # Perception can use an image from the control period after the one in which it appears.
        return delay + scenario.poil.rates.control

    def MakeImagelessTracker(self, plan: ExecutionPlan) -> GroundTruthTracker | None:
        """Returns a ground-truth tracker if `poil.tracker` names it, else None."""
        poil = self.scenario.poil
        if poil.tracker != GROUND_TRUTH:
            return None
        return GroundTruthTracker(
            body_index=self.object_body().index(),
            query_points=plan.target_points,
            config=GroundTruthTrackerConfig(period=poil.rates.tracker, latency=poil.latency),
        )

    def TakeImages(self, context: Context, *, labels: bool = False) -> tuple[RgbdImage, ...]:
        """See `Station.TakeImages`; the images have the scenario's faults at the context's time."""
        injector = MakeFaultInjector(self.scenario)
        wanted = labels or injector.needs_labels(context.get_time())
        images = self._true_images(context, labels=wanted)
        frame = MultiViewFrame(self.camera_models, images, self.label_ids if wanted else {})
        images = injector.apply(frame).images
        return images if labels else tuple(replace(image, label=None) for image in images)

    def _true_images(self, context: Context, *, labels: bool) -> tuple[RgbdImage, ...]:
        """Returns each camera's current image without faults."""
        if self._camera_process is None:
            return tuple(self._image(context, name, labels) for name in self.camera_names)
        plant_context = self.GetSubsystemContext(self._plant, context)
        scene = (self._plant.GetPositions(plant_context), context.get_time())
        images = by_name(self.camera_names, self._camera_process.render(*scene))
        if labels:
            found = by_name(self.camera_names, self._camera_process.render_labels(*scene))
            images = tuple(replace(i, label=n) for i, n in zip(images, found, strict=True))
        return images

    def _image(self, context: Context, name: str, labels: bool) -> RgbdImage:
        """Renders one camera's current image, and returns a copy of it."""

        def pixels(kind: str) -> np.ndarray:
            return self.GetOutputPort(f"{name}.{kind}_image").Eval(context).data

        label = pixels("label")[:, :, 0] if labels else None
        return copied_image(pixels("rgb"), pixels("depth"), label, stamp=context.get_time())

    def Start(self) -> None:
        """Starts the process that renders delayed cameras, without waiting for it."""
        if self._camera_process is not None:
            self._camera_process.start()

    def WarmUp(self) -> None:
        """Waits for the first rendering of delayed cameras, which takes longest.

        Raises:
            PoilError: if the cameras cannot be used.
        """
        if self._camera_process is not None:
            self._camera_process.warm_up()

    def Close(self) -> None:
        """Ends the process that renders delayed cameras. The station cannot be used afterwards."""
        if self._camera_process is not None and self._delayed_cameras is not None:
            # First the thread that sends requests, then the process that answers them.
            self._delayed_cameras.close()
            self._camera_process.close()

    def object_body(self) -> RigidBody:
        """Returns the object's base body, whose frame is the object's frame O."""
        return BaseBody(self._plant, self.scenario.poil.object)

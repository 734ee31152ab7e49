"""The interface of all stations: simulated, real or replayed."""

from collections.abc import Callable, Mapping, Sequence
from typing import Self

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, System

from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.errors import ScenarioError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.robots.panda import BASE_LINK
from poil_drake.systems.capture_timing import CaptureTiming

COMMANDS = ("velocity", "velocity_time")
"""Names of an arm's input ports."""

MEASUREMENTS = ("position_measured", "velocity_measured", "torque_external")
"""Names of an arm's output ports, except `status`."""


class Station(Diagram):
    """A robot, its hand and its cameras, with named ports.

    `Start` starts the station's threads and processes, `WarmUp` waits until they are ready, and
    `Close` ends them; a `with` block does all three.

    Attributes:
        scenario: The scenario of the station.
        label_ids: Render labels by name, such as "mug", "mug/handle" or "rack".
        camera_models: Intrinsics and fixed poses of the cameras.
        tracker_timing: When a tracker captures images of the station and releases its results.
        detector_timing: When a detector captures images of the station and releases its results.
        clock: Returns real time [s] on hardware, recorded time [s] in a replay; None in simulation.
    """

    scenario: Scenario
    label_ids: Mapping[str, tuple[int, ...]]
    camera_models: tuple[CameraModel, ...] = ()
    tracker_timing: CaptureTiming
    detector_timing: CaptureTiming
    clock: Callable[[], float] | None = None
    _plant: MultibodyPlant
    _scene_graph: SceneGraph

    def __enter__(self) -> Self:
        try:
            self.Start()
            self.WarmUp()
        except BaseException:
            self.Close()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        self.Close()

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The names of the cameras; empty if the station was built without cameras."""
        return tuple(camera.name for camera in self.camera_models)

    def MakeImagelessTracker(self, plan: ExecutionPlan) -> LeafSystem | None:
        """Returns the station's own tracker if it needs no images, otherwise None.

        Such trackers are the true poses in simulation, and the recorded tracks of a replay.

        Args:
            plan: The plan whose target points are tracked.

        Raises:
            ScenarioError: if `poil.tracker` is ground truth, but the station is not simulated.
        """
        if self.scenario.poil.tracker == GROUND_TRUTH:
            raise ground_truth_error()
        return None

    def TakeImages(self, context: Context, *, labels: bool = False) -> tuple[RgbdImage, ...]:
        """Returns each camera's current image; `CaptureFrame` combines them into a frame.

        Args:
            context: The station's own context.
            labels: Whether to include label images.

        Raises:
            StationError: if the images cannot be captured.
        """
        raise NotImplementedError

    def ArmPosition(self, context: Context) -> np.ndarray:
        """Returns the arm's current measured joint positions (7,) [rad].

        Args:
            context: The station's own context.
        """
        port = self.GetOutputPort(f"{self.scenario.poil.robot}.position_measured")
        return np.array(port.Eval(context))

    def Start(self) -> None:
        """Starts the station's threads and processes, without waiting for them."""

    def WarmUp(self) -> None:
        """Waits until the station's threads and processes are ready.

        Raises:
            PoilError: if one of them cannot be used.
        """

    def Close(self) -> None:
        """Ends the station's threads and processes. The station cannot be used afterwards."""

    def Rest(self) -> None:
        """Brings the robot to rest without the control loop, and waits until it rests."""

    def HandleMessages(self) -> None:
        """Handles received messages, so that the next update sees them."""

    def Problems(self) -> tuple[str, ...]:
        """Returns problems of the station's threads, processes and networks, one clause each."""
        return ()

    def plant(self) -> MultibodyPlant:
        """Returns the plant of the scenario's models; only `SimulatedStation` simulates it."""
        return self._plant

    def scene_graph(self) -> SceneGraph:
        """Returns the plant's scene graph."""
        return self._scene_graph

    def robot_base_pose(self) -> RigidTransform:
        """Returns X_WB, the pose of the robot's fixed base."""
        plant = self._plant
        robot = plant.GetModelInstanceByName(self.scenario.poil.robot)
        return plant.GetBodyByName(BASE_LINK, robot).EvalPoseInWorld(plant.CreateDefaultContext())


def ground_truth_error() -> ScenarioError:
    """Returns the error for a ground-truth tracker on hardware."""
    return ScenarioError(
        f"The tracker '{GROUND_TRUTH}' needs the simulator's poses, which hardware does not have.",
        remedy="Set poil.tracker to one that uses cameras, e.g. rigid_flow.",
    )


def ExportPorts(builder: DiagramBuilder, system: System, names: Sequence[str], model: str) -> None:
    """Exports the named input and output ports of a system as "<model>.<name>"."""
    for name in names:
        if system.HasInputPort(name):
            builder.ExportInput(system.GetInputPort(name), f"{model}.{name}")
        else:
            builder.ExportOutput(system.GetOutputPort(name), f"{model}.{name}")


def ExportOutputs(builder: DiagramBuilder, system: System) -> None:
    """Exports all output ports of a system under their own names."""
    for k in range(system.num_output_ports()):
        port = system.get_output_port(k)
        builder.ExportOutput(port, port.get_name())

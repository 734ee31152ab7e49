"""The interface of all stations: simulated, real or replayed."""

from collections.abc import Callable, Mapping
from typing import Self

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, LeafSystem

from poil_drake.diagrams.scenario.checks import GROUND_TRUTH
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.hardware.hardware_checks import ground_truth_error
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.robots.panda import BASE_LINK
from poil_drake.systems.capture_timing import CaptureTiming


class Station(Diagram):
    """A robot, its hand and its cameras behind named ports: see `MakeStation`.

    `Start` starts the threads and processes beside it, `WarmUp` waits until they are ready, and
    `Close` ends them; a `with` block does all three.

    Attributes:
        scenario: The scenario of the station.
        label_ids: Render labels by name: "mug", "mug/handle", "rack", ...
        camera_models: The cameras' models; cameras do not move.
    """

    scenario: Scenario
    label_ids: Mapping[str, tuple[int, ...]]
    camera_models: tuple[CameraModel, ...] = ()
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
        """The names of the cameras; empty if the station was built without."""
        return tuple(camera.name for camera in self.camera_models)

    @property
    def tracker_timing(self) -> CaptureTiming:
        """When a tracker of the station's images captures and releases."""
        raise NotImplementedError

    @property
    def detector_timing(self) -> CaptureTiming:
        """When a detector in the station's images captures and releases."""
        raise NotImplementedError

    def MakeImagelessTracker(self, plan: ExecutionPlan) -> LeafSystem | None:
        """Returns a tracker that needs no images, None where images are to be tracked.

        Args:
            plan: Its points are followed.

        Raises:
            ScenarioError: if the scenario names the ground truth, but the station has none.
        """
        if self.scenario.poil.tracker == GROUND_TRUTH:
            raise ground_truth_error()
        return None

    @property
    def clock(self) -> Callable[[], float] | None:
        """The clock [s] that also runs while the context does not advance; None in simulation."""
        return None

    def TakeImages(self, context: Context, *, labels: bool = False) -> tuple[RgbdImage, ...]:
        """Returns what each camera sees now, (H, W) each; `CaptureFrame` makes a frame of it.

        Args:
            context: The station's own context.
            labels: Whether to include label images.

        Raises:
            StationError: if there are no images.
        """
        raise NotImplementedError

    def ArmPosition(self, context: Context) -> np.ndarray:
        """Returns the arm's measured joint positions (7,) [rad] now.

        Args:
            context: The station's own context.
        """
        port = self.GetOutputPort(f"{self.scenario.poil.robot}.position_measured")
        return np.array(port.Eval(context))

    def Start(self) -> None:
        """Starts the threads and processes beside the station, without waiting for them."""

    def WarmUp(self) -> None:
        """Waits until they are ready.

        Raises:
            PoilError: if one cannot be used.
        """

    def Close(self) -> None:
        """Ends them. The station cannot be used afterwards."""

    def Rest(self) -> None:
        """Brings the robot to rest, independently of the loop, and waits for that."""

    def HandleMessages(self) -> None:
        """Handles received messages, so that the next update sees them."""

    def Problems(self) -> tuple[str, ...]:
        """Returns the problems of its threads, processes and networks, a sentence each."""
        return ()

    def plant(self) -> MultibodyPlant:
        """Returns the simulated plant; on hardware, a plant of the scenario's models."""
        return self._plant

    def scene_graph(self) -> SceneGraph:
        """Returns the plant's scene graph."""
        return self._scene_graph

    def robot_base_pose(self) -> RigidTransform:
        """Returns X_WB, the pose of the robot's fixed base."""
        plant = self._plant
        robot = plant.GetModelInstanceByName(self.scenario.poil.robot)
        return plant.GetBodyByName(BASE_LINK, robot).EvalPoseInWorld(plant.CreateDefaultContext())

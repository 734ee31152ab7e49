"""What every station has, simulated or real."""

from collections.abc import Callable, Mapping
from typing import Self

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram

from poil_drake.diagrams.loop.recorded_perception import RecordedPerception
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.robots.panda import BASE_LINK


class Station(Diagram):
    """A robot, its hand and its cameras behind named ports: see `MakeStation`.

    After it was built, `Start` starts what works beside it, `WarmUp` waits for that, and `Close`
    ends it; or use it as a `with` block, which does all three.
    """

    _scenario: Scenario
    _plant: MultibodyPlant
    _scene_graph: SceneGraph
    _label_ids: Mapping[str, tuple[int, ...]]
    _camera_models: tuple[CameraModel, ...] = ()
    _camera_delay: float = 0.0

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
    def scenario(self) -> Scenario:
        """What the station was built from."""
        return self._scenario

    @property
    def label_ids(self) -> Mapping[str, tuple[int, ...]]:
        """Which labels stand for what in label images: "mug", "mug/handle", "rack", ..."""
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
    def recorded(self) -> RecordedPerception | None:
        """What of the perception is to be repeated, where the station replays a run; else None."""
        return None

    @property
    def camera_delay(self) -> float:
        """From the capture of the exported images to their appearance, where it is fixed [s]."""
        return self._camera_delay

    @property
    def clock(self) -> Callable[[], float] | None:
        """Shows how long nobody advanced the context [s]; None where only its own time counts."""
        return None

    def TakeImages(self, context: Context, *, labels: bool = False) -> tuple[RgbdImage, ...]:
        """Returns what each camera sees now, (H, W) each; `CaptureFrame` makes a frame of it.

        Args:
            context: The station's own context.
            labels: Whether to have the label images, too.

        Raises:
            StationError: if there are no images to be had.
        """
        raise NotImplementedError

    def ArmPosition(self, context: Context) -> np.ndarray:
        """Returns the arm's measured joint positions (7,) [rad] now.

        Args:
            context: The station's own context.
        """
        raise NotImplementedError

    def Start(self) -> None:
        """Starts what works beside the station, without waiting for it."""

    def WarmUp(self) -> None:
        """Waits until what was started is ready.

        Raises:
            PoilError: if it cannot be used.
        """

    def Close(self) -> None:
        """Ends what was started. The station is of no use after that."""

    def Rest(self) -> None:
        """Brings the robot to rest, whatever the loop does, and waits for that."""

    def HandleMessages(self) -> None:
        """Takes in what others have sent, so that the next update knows it."""

    def Problems(self) -> tuple[str, ...]:
        """Returns what is wrong with the parts that work beside the station, a sentence each."""
        return ()

    def plant(self) -> MultibodyPlant:
        """Returns the simulated plant; on hardware, the model that it was made from."""
        return self._plant

    def scene_graph(self) -> SceneGraph:
        """Returns the plant's scene graph."""
        return self._scene_graph

    def robot_base_pose(self) -> RigidTransform:
        """Returns X_WB, the pose of the robot's base, which does not move."""
        plant = self._plant
        robot = plant.GetModelInstanceByName(self._scenario.poil.robot)
        return plant.GetBodyByName(BASE_LINK, robot).EvalPoseInWorld(plant.CreateDefaultContext())

"""Cameras of the simulated station."""

import copy
import math
import re
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from functools import partial

import numpy as np
from pydrake.common.schema import Transform
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import GetScopedFrameByName
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import LcmBuses
from pydrake.systems.sensors import ApplyCameraConfig, CameraConfig, RgbdSensor

from poil_drake.diagrams.scenario.drake_errors import DrakeErrorsExplained
from poil_drake.diagrams.scenario.scenario import NO_NETWORK, Scenario
from poil_drake.errors import ScenarioError
from poil_drake.geometry.depth_image import register_depth
from poil_drake.perception.images import CameraModel
from poil_drake.systems.cameras.depth_noise import DepthNoiseSystem

_LARGEST_SIDE = 8192  # [px], more than any depth camera has: a typo would exhaust the memory


def AddCameras(
    *,
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scenario: Scenario,
    lcm_buses: LcmBuses,
) -> tuple[CameraModel, ...]:
    """Adds cameras with depth noise but without a delay, and exports their images.

    An image is rendered when its port is evaluated. Exports `<name>.rgb_image` (ImageRgba8U),
    `<name>.depth_image` (ImageDepth32F [m], noisy, 0 where invalid), `<name>.label_image`
    (ImageLabel16I) and `<name>.image_time` (1,), the current time [s].

    Args:
        builder: Receives the cameras; must already hold the plant.
        plant: The plant that the cameras see.
        scenario: Describes the cameras and the noise of their depth images.
        lcm_buses: The LCM networks to which Drake may publish the images.

    Returns:
        The cameras' models.

    Raises:
        ScenarioError: if a camera's name differs from its key, a camera is mounted on a body that
            moves, or Drake does not accept a value of a configuration.
    """
    models = MakeCameraModels(plant, scenario.cameras)
    for index, (name, config) in enumerate(scenario.cameras.items()):
        _apply(name, config, builder, lcm_buses)
        sensor = builder.GetSubsystemByName(f"rgbd_sensor_{name}")
        depth = builder.AddNamedSystem(
            f"depth_noise_{name}",
            DepthNoiseSystem(
                width=config.width,
                height=config.height,
                config=scenario.poil.depth_noise,
                seed=scenario.random_seed,
                camera_index=index,
                register=_registration(sensor),
            ),
        )
        builder.Connect(sensor.depth_image_32F_output_port(), depth.GetInputPort("depth_image"))
        builder.ExportOutput(sensor.color_image_output_port(), f"{name}.rgb_image")
        builder.ExportOutput(depth.GetOutputPort("noisy_depth_image"), f"{name}.depth_image")
        builder.ExportOutput(sensor.label_image_output_port(), f"{name}.label_image")
        builder.ExportOutput(sensor.image_time_output_port(), f"{name}.image_time")
    return models


def _registration(sensor: RgbdSensor) -> Callable[[np.ndarray], np.ndarray] | None:
    """Returns how depth images are registered to colour; None if both cameras have one pose."""
    color = sensor.default_color_render_camera().core()
    depth = sensor.default_depth_render_camera().core()
    X_CD = color.sensor_pose_in_camera_body().inverse() @ depth.sensor_pose_in_camera_body()
    if X_CD.IsNearlyIdentity(1e-9):
        return None
    return partial(
        register_depth,
        K_D=depth.intrinsics().intrinsic_matrix(),
        K_C=color.intrinsics().intrinsic_matrix(),
        X_CD=X_CD.GetAsMatrix4(),
        size=(color.intrinsics().height(), color.intrinsics().width()),
    )


def CameraDelay(cameras: Mapping[str, CameraConfig]) -> float:
    """Returns the `output_delay` [s] that all cameras share; 0 without cameras.

    Raises:
        ScenarioError: if the delays differ, or if a delay is negative or not finite.
    """
    delays = {name: config.output_delay for name, config in cameras.items()}
    for name, delay in delays.items():
        first, expected = next(iter(delays.items()))
        if not 0.0 <= delay < math.inf:
            raise ScenarioError(
                f"cameras.{name}.output_delay is {delay} s, which is negative or not finite.",
                remedy="Set it to a finite time of at least 0 s.",
            )
        if delay != expected:
            raise ScenarioError(
                f"cameras.{name}.output_delay is {delay} s, but cameras.{first}.output_delay is "
                f"{expected} s: a frame needs images of one instant.",
                remedy="Set the same output_delay for all cameras.",
            )
    return next(iter(delays.values()), 0.0)


def MakeCameraModels(
    plant: MultibodyPlant, cameras: Mapping[str, CameraConfig]
) -> tuple[CameraModel, ...]:
    """Returns the cameras' pinhole models.

    Raises:
        ScenarioError: as in `AddCameras`.
    """
    models = []
    for name, config in cameras.items():
        _check_camera(name, config)
        X_WB = _require_at_rest(plant, name, config)
        with _camera_errors_explained(name):
            core = config.MakeCameras()[0].core()
        # Drake's camera frame is the optical frame.
        X_WC = X_WB @ core.sensor_pose_in_camera_body()
        info = core.intrinsics()
        models.append(
            CameraModel(
                name=name,
                width=info.width(),
                height=info.height(),
                K=info.intrinsic_matrix(),
                X_WC=X_WC.GetAsMatrix4(),
            )
        )
    return tuple(models)


def CheckCameras(cameras: Mapping[str, CameraConfig], lcm_buses: LcmBuses) -> None:
    """Checks that Drake accepts the settings of cameras that another process will render.

    Raises:
        ScenarioError: if Drake does not accept a value of a configuration.
    """
    builder = DiagramBuilder()
    AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    for name, config in cameras.items():
        alone = copy.copy(config)
        alone.X_PB = Transform()
        _apply(name, alone, builder, lcm_buses)


def _apply(name: str, config: CameraConfig, builder: DiagramBuilder, lcm_buses: LcmBuses) -> None:
    """Adds a camera, ignoring its `output_delay`."""
    config = copy.copy(config)
    config.output_delay = 0.0
    # Drake's renderers measure from the image's corner, so that the first pixel's centre is at
    # (0.5, 0.5). In the cameras' models, as in those of real cameras, it is at (0, 0).
    config.center_x, config.center_y = np.add(config.principal_point(), 0.5)
    lcm = None
    if not (config.rgb or config.depth or config.label):
        # Drake leaves out a camera that publishes nothing.
        config.rgb = True
        lcm = DrakeLcm(NO_NETWORK)
    with _camera_errors_explained(name):
        ApplyCameraConfig(config, builder, lcm_buses=lcm_buses, lcm=lcm)


def _camera_errors_explained(name: str) -> AbstractContextManager[None]:
    return DrakeErrorsExplained(
        f"cameras.{name} cannot be used",
        remedy=f"Correct cameras.{name}; see Drake's CameraConfig for the valid values.",
    )


def _check_camera(name: str, config: CameraConfig) -> None:
    if config.name != name:
        raise ScenarioError(
            f"The camera under the key '{name}' is named '{config.name}'; the two must be equal.",
            remedy=f"Set cameras.{name}.name to '{name}'.",
        )
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise ScenarioError(
            f"The camera name '{name}' cannot be part of the names of ports and topics.",
            remedy="Use a name of letters, digits, '_' and '-'.",
        )
    if max(config.width, config.height) > _LARGEST_SIDE:
        raise ScenarioError(
            f"cameras.{name} has {config.width} x {config.height} pixels, which is too large.",
            remedy=f"Set its width and height to at most {_LARGEST_SIDE}.",
        )
    if config.capture_offset != 0.0:
        raise ScenarioError(
            f"cameras.{name}.capture_offset is {config.capture_offset} s; only 0 is supported.",
            remedy="Leave it out: all cameras capture at multiples of poil.rates.tracker.",
        )


def _require_at_rest(plant: MultibodyPlant, name: str, config: CameraConfig) -> RigidTransform:
    """Returns X_WB, the pose of a camera's body, after checking that the body cannot move."""
    path = f"cameras.{name}.X_PB"
    base = config.X_PB.base_frame or "world"
    with DrakeErrorsExplained(
        f"{path} cannot be used",
        remedy="Use a deterministic pose. Leave base_frame out for the world, or name a frame "
        "that is welded to the world.",
    ):
        wrong = [
            key
            # X_BC and X_BD are the poses of the colour and the depth camera in the camera's body.
            for key in ("X_PB", "X_BC", "X_BD")
            if not np.isfinite(getattr(config, key).GetDeterministicValue().GetAsMatrix4()).all()
        ]
        frame = GetScopedFrameByName(plant, base)
    if wrong:
        raise ScenarioError(
            f"cameras.{name}.{', '.join(wrong)} is not finite.", remedy="Use finite numbers."
        )
    if not plant.IsAnchored(frame.body()):
        raise ScenarioError(
            f"{path}.base_frame is '{base}', which moves; moving cameras are not supported.",
            remedy="Name a frame that is welded to the world.",
        )
    X_WP = frame.CalcPoseInWorld(plant.CreateDefaultContext())
    return X_WP @ config.X_PB.GetDeterministicValue()

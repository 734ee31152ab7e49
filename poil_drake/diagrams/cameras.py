"""Cameras of the simulated station, and whole frames taken with them."""

import re
from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import GetScopedFrameByName
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.lcm import LcmBuses
from pydrake.systems.sensors import ApplyCameraConfig, CameraConfig, CameraInfo, RgbdSensor

from poil_drake.diagrams.drake_errors import DRAKE_ERRORS, drake_reason
from poil_drake.errors import ScenarioError
from poil_drake.perception.depth_noise import StereoDepthNoiseConfig
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.systems.camera_ports import copied_depth, copied_rgb
from poil_drake.systems.depth_noise_system import DepthNoiseSystem

_LARGEST_SIDE = 8192  # [px]: more than any depth camera has; a slip would fill the memory


def AddCameras(
    *,
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    cameras: Mapping[str, CameraConfig],
    lcm_buses: LcmBuses,
    noise: StereoDepthNoiseConfig,
    seed: int,
) -> dict[str, RgbdSensor]:
    """Adds the cameras, and noise on their depth, and exports their images.

    Nothing renders by itself: an image is rendered when somebody evaluates its port, so consumers
    sample in their own periodic events.

    Exports `<name>.rgb_image` (ImageRgba8U), `<name>.depth_image` (ImageDepth32F, noisy, 0 where
    invalid) and `<name>.label_image` (ImageLabel16I).

    Returns:
        The sensors by name.

    Raises:
        ScenarioError: when a camera is named differently inside and outside, delays its images,
            moves, or has a value that Drake does not take.
    """
    sensors = {}
    for index, (name, config) in enumerate(cameras.items()):
        _check_camera(name, config)
        _require_at_rest(plant, name, config)
        try:
            ApplyCameraConfig(config, builder, lcm_buses=lcm_buses)
        except DRAKE_ERRORS as error:
            raise ScenarioError(
                f"cameras.{name} cannot be used: {drake_reason(error)}.",
                remedy=f"Correct cameras.{name}; Drake's CameraConfig lists what there is.",
            ) from error
        sensor = builder.GetSubsystemByName(f"rgbd_sensor_{name}")
        depth = builder.AddNamedSystem(
            f"depth_noise_{name}",
            DepthNoiseSystem(
                width=config.width,
                height=config.height,
                config=noise,
                seed=seed,
                camera_index=index,
            ),
        )
        builder.Connect(sensor.depth_image_32F_output_port(), depth.GetInputPort("depth_image"))
        builder.ExportOutput(sensor.color_image_output_port(), f"{name}.rgb_image")
        builder.ExportOutput(depth.GetOutputPort("noisy_depth_image"), f"{name}.depth_image")
        builder.ExportOutput(sensor.label_image_output_port(), f"{name}.label_image")
        sensors[name] = sensor
    return sensors


def _check_camera(name: str, config: CameraConfig) -> None:
    if config.name != name:
        raise ScenarioError(
            f"The camera under the key '{name}' is named '{config.name}'.",
            remedy=f"Write 'name: {name}' in cameras.{name}.",
        )
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise ScenarioError(
            f"A camera is named '{name}'.",
            remedy="Use letters, digits, '_' and '-': the name becomes part of ports and topics.",
        )
    if max(config.width, config.height) > _LARGEST_SIDE:
        raise ScenarioError(
            f"cameras.{name} has {config.width} x {config.height} pixels.",
            remedy=f"At most {_LARGEST_SIDE} either way are drawn.",
        )
    if config.output_delay > 0:
        raise ScenarioError(
            f"cameras.{name}.output_delay is {config.output_delay} s.",
            remedy="Leave it at 0 and set poil.latency, which delays what the tracker gives.",
        )


def _require_at_rest(plant: MultibodyPlant, name: str, config: CameraConfig) -> None:
    """Checks that a camera stays where it is: those who look through it know its pose once."""
    path = f"cameras.{name}.X_PB"
    # The camera's own poses: of its colour and its depth image in its body.
    poses = {key: getattr(config, key) for key in ("X_PB", "X_BC", "X_BD")}
    base = config.X_PB.base_frame or "world"
    try:
        finite = {
            key: np.isfinite(pose.GetDeterministicValue().GetAsMatrix4()).all()
            for key, pose in poses.items()
        }
        frame = GetScopedFrameByName(plant, base)
    except DRAKE_ERRORS as error:
        raise ScenarioError(
            f"{path} cannot be used: {drake_reason(error)}.",
            remedy="Name an existing base_frame that is not the robot's, or none for the world, "
            "and give one certain pose.",
        ) from error
    if not all(finite.values()):
        wrong = ", ".join(key for key in finite if not finite[key])
        raise ScenarioError(f"cameras.{name}.{wrong} is not finite.", remedy="Correct its numbers.")
    if not plant.IsAnchored(frame.body()):
        raise ScenarioError(
            f"{path}.base_frame is '{base}', which moves; moving cameras are not supported.",
            remedy="Mount the camera on what is welded to the world.",
        )


def MakeCameraModel(*, name: str, info: CameraInfo, X_WC: RigidTransform) -> CameraModel:
    """Returns the pinhole model of a camera at a pose; Drake's camera frame is optical already."""
    return CameraModel(
        name=name,
        width=info.width(),
        height=info.height(),
        K=info.intrinsic_matrix(),
        X_WC=X_WC.GetAsMatrix4(),
    )


def SensorCameraModel(
    *, diagram: Diagram, context: Context, name: str, sensor: RgbdSensor
) -> CameraModel:
    """Returns a simulated camera's model, at the pose that it has now."""
    core = sensor.default_color_render_camera().core()
    sensor_context = diagram.GetSubsystemContext(sensor, context)
    X_WB = sensor.body_pose_in_world_output_port().Eval(sensor_context)
    return MakeCameraModel(
        name=name, info=core.intrinsics(), X_WC=X_WB @ core.sensor_pose_in_camera_body()
    )


def ReadImage(*, diagram: Diagram, context: Context, name: str, labels: bool) -> RgbdImage:
    """Renders one camera's image now, copied from Drake's cache.

    Args:
        diagram: The diagram that exports the camera's ports.
        context: The diagram's own context.
        name: The camera's name.
        labels: Whether to render the label image, too.
    """
    rgba = diagram.GetOutputPort(f"{name}.rgb_image").Eval(context).data
    depth = diagram.GetOutputPort(f"{name}.depth_image").Eval(context).data
    label = None
    if labels:
        label = np.array(
            diagram.GetOutputPort(f"{name}.label_image").Eval(context).data[:, :, 0],
            dtype=np.int16,
        )
    return RgbdImage(
        rgb=copied_rgb(rgba),
        depth=copied_depth(depth),
        stamp=context.get_time(),
        label=label,
    )


def MakeFrame(
    models: tuple[CameraModel, ...],
    images: tuple[RgbdImage, ...],
    label_ids: Mapping[str, tuple[int, ...]],
) -> MultiViewFrame:
    """Returns the frame of all cameras; labels are named only where the images have them."""
    labelled = all(image.label is not None for image in images)
    return MultiViewFrame(
        cameras=models, images=images, label_ids=dict(label_ids) if labelled else {}
    )

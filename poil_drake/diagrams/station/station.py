"""The station: a robot, its cameras and its surroundings behind named ports."""

from collections.abc import Sequence
from pathlib import Path

from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from poil_drake.diagrams.scenario.model_parts import BaseBody, BodiesByModel, IsPartOf
from poil_drake.diagrams.scenario.penetrations import START_TOLERANCE, Penetrations
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import CameraDelay
from poil_drake.diagrams.station.hardware.hardware_station import HardwareStation as HardwareStation
from poil_drake.diagrams.station.simulated_station import SimulatedStation as SimulatedStation
from poil_drake.diagrams.station.station_base import Station as Station
from poil_drake.diagrams.station.station_models import PrefinalizeCallback
from poil_drake.errors import ScenarioError, StationError
from poil_drake.perception.detectors.registry import LABEL_IMAGE
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.robot_filter import without_robot
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.stopwatch import Stopwatch


def MakeStation(
    scenario: Scenario,
    *,
    meshcat: Meshcat | None = None,
    hardware: bool = False,
    dry_run: bool = False,
    cameras: bool = True,
    ignore_output_delay: bool = False,
    package_xmls: Sequence[str | Path] = (),
    stopwatch: Stopwatch | None = None,
    parser_preload_callback: PrefinalizeCallback | None = None,
    parser_prefinalize_callback: PrefinalizeCallback | None = None,
) -> Station:
    """Builds the station of a scenario.

    Args:
        scenario: The models, the cameras and the task.
        meshcat: Shows the scene; None shows nothing.
        hardware: Whether to make a `HardwareStation` instead of a `SimulatedStation`. The ports are
            the same, except those that only a simulation has.
        dry_run: On hardware, whether to move a `KinematicRobot` and send nothing to the robot.
        cameras: Whether to add the cameras and the renderer; leave them out for speed.
        ignore_output_delay: Whether to render images when their ports are evaluated, regardless of
            the cameras' `output_delay`. Set this to take pictures without simulating.
        package_xmls: Further `package.xml` files, for `package://` URLs in the directives.
        stopwatch: Receives the times spent on rendering delayed images and on waiting for them.
        parser_preload_callback: Called with the parser before the directives are read.
        parser_prefinalize_callback: Called with the parser before the plant is finalized.

    Raises:
        ScenarioError: if the scenario is inconsistent.
        StationError: if the robot is not a Panda, parser callbacks are combined with delayed
            cameras, or the robot's network cannot be used.
        MissingDependencyError: if the Panda's description is not installed.
    """
    if hardware:
        return HardwareStation(
            scenario,
            meshcat=meshcat,
            cameras=cameras,
            package_xmls=package_xmls,
            dry_run=dry_run,
            parser_preload_callback=parser_preload_callback,
            parser_prefinalize_callback=parser_prefinalize_callback,
        )
    callbacks = (parser_preload_callback, parser_prefinalize_callback)
    if cameras and not ignore_output_delay and any(callbacks) and CameraDelay(scenario.cameras):
        raise StationError(
            "Parser callbacks are not supported with delayed cameras (output_delay), which another "
            "process renders.",
            remedy="Set the cameras' output_delay to 0, or use ignore_output_delay=True.",
        )
    return SimulatedStation(
        scenario,
        meshcat=meshcat,
        cameras=cameras,
        ignore_output_delay=ignore_output_delay,
        package_xmls=package_xmls,
        stopwatch=stopwatch,
        parser_preload_callback=parser_preload_callback,
        parser_prefinalize_callback=parser_prefinalize_callback,
    )


def RequireLabels(station: Station) -> None:
    """Checks that a camera provides label images, if the detector reads them.

    Raises:
        ScenarioError: if no camera provides them.
    """
    names = station.camera_names
    labelled = any(station.HasOutputPort(f"{name}.label_image") for name in names)
    if station.scenario.poil.detector == LABEL_IMAGE and names and not labelled:
        raise ScenarioError(
            f"The detector '{LABEL_IMAGE}' reads label images, which none of the cameras "
            f"{', '.join(names)} provides.",
            remedy="Use a source with label images: a segmentation node that sends images and "
            f"labels over LCM (poil.hardware.cameras.{names[0]}: !LcmImages {{}}), or a recording "
            "that contains labels (!McapPlayback).",
        )


def RequireFreeStart(station: Station) -> None:
    """Checks that what can move freely in a simulation starts on something, and inside nothing.

    Raises:
        ScenarioError: if a model starts in the air or inside another.
    """
    if not isinstance(station, SimulatedStation):
        return
    poil, plant, context = station.scenario.poil, station.plant(), station.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    query = station.GetOutputPort("query_object")
    models = tuple(BodiesByModel(plant, (poil.object, poil.fixture)))
    for model in models:
        body = BaseBody(plant, model)
        holds_others = any(other != model and IsPartOf(other, model) for other in models)
        if holds_others or not body.is_floating_base_body():
            continue
        found = Penetrations(plant, query.Eval(context), model, fixture=poil.fixture)
        # A mesh counts as its convex hull, which may have been allowed to be wrong.
        deep = [
            f"{1000 * one.depth:.0f} mm inside '{one.geometry}'"
            for one in found
            if one.depth > START_TOLERANCE and not (one.is_mesh and poil.collision == "hull")
        ]
        X_WB = body.EvalPoseInWorld(plant_context)
        lowered = X_WB.translation() - [0.0, 0.0, START_TOLERANCE]
        plant.SetFreeBodyPose(plant_context, body, RigidTransform(X_WB.rotation(), lowered))
        below = Penetrations(plant, query.Eval(context), model, fixture=poil.fixture)
        plant.SetFreeBodyPose(plant_context, body, X_WB)
        if deep or not below:
            air = f"in the air: nothing is within {1000 * START_TOLERANCE:.0f} mm below it"
            raise ScenarioError(
                f"The model '{model}' starts {deep[0] if deep else air}.",
                remedy="Correct default_free_body_pose or add_weld in the directives. A model with "
                "neither is at the world's origin, and what carries others needs collision "
                "geometry.",
            )


def CaptureFrame(station: Station, context: Context, *, labels: bool = False) -> MultiViewFrame:
    """Returns a frame of images that every camera captures now, regardless of output delays.

    Args:
        station: The station.
        context: The station's own context, not that of a diagram around it.
        labels: Whether to include label images, which take additional time to render. The frame
            has label IDs if a camera provides labels.

    Raises:
        StationError: if the station has no cameras, or cannot capture images.
    """
    if not station.camera_names:
        raise StationError(
            "The station has no cameras.",
            remedy="Add cameras to the scenario, and build the station with cameras=True.",
        )
    images = station.TakeImages(context, labels=labels)
    labelled = any(image.label is not None for image in images)
    return MultiViewFrame(
        cameras=station.camera_models,
        images=images,
        label_ids=dict(station.label_ids) if labelled else {},
    )


def WithoutRobot(station: Station, context: Context, frame: MultiViewFrame) -> MultiViewFrame:
    """Returns a frame that the station captured, without depth where it shows the robot.

    Args:
        station: The station.
        context: The station's own context, at the time of the frame.
        frame: The frame.
    """
    model = PandaModel(X_WB=station.robot_base_pose().GetAsMatrix4())
    opening = float(station.GetOutputPort("hand.width_measured").Eval(context)[0])
    return without_robot(frame, model, station.ArmPosition(context), opening)


def CaptureScene(scenario: Scenario, *, hardware: bool = False) -> MultiViewFrame:
    """Returns a frame of a scenario's cameras. The real robot is not needed for it.

    Args:
        scenario: The cameras, and what they see in a simulation.
        hardware: Whether to use the real cameras instead of rendered images.

    Raises:
        PoilError: if there are no cameras, or no images.
    """
    station = MakeStation(scenario, hardware=hardware, dry_run=True, ignore_output_delay=True)
    try:
        # No `with` block, which would wait for the robot.
        station.Start()
        return CaptureFrame(station, station.CreateDefaultContext())
    finally:
        station.Close()

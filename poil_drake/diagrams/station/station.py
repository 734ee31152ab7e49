"""The station: a robot, its cameras and its surroundings behind named ports."""

from collections.abc import Sequence
from pathlib import Path

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import CameraDelay, MakeFrame
from poil_drake.diagrams.station.hardware.hardware_checks import label_error
from poil_drake.diagrams.station.hardware.hardware_station import HardwareStation
from poil_drake.diagrams.station.simulated_station import SimulatedStation
from poil_drake.diagrams.station.station_base import Station
from poil_drake.diagrams.station.station_models import PrefinalizeCallback
from poil_drake.errors import StationError
from poil_drake.perception.detectors.registry import LABEL_IMAGE
from poil_drake.perception.images import MultiViewFrame
from poil_drake.runtime.stopwatch import Stopwatch

__all__ = [
    "CaptureFrame",
    "HardwareStation",
    "MakeStation",
    "RequireLabels",
    "SimulatedStation",
    "Station",
]


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
        scenario: What stands where, and how it behaves.
        meshcat: Shows the scene there.
        hardware: Whether the robot is the real one: a `HardwareStation`, else a
            `SimulatedStation`. Its ports are the same, but for what only a simulation knows.
        dry_run: On hardware: whether nothing is sent to the robot, and a `KinematicRobot` moves.
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
            "A station whose cameras have an output_delay got a parser callback, of which the "
            "process that renders would not know.",
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
    """Checks that a detector which reads label images gets them from every camera.

    Raises:
        ScenarioError: naming a camera that gives none.
    """
    poil = station.scenario.poil
    for name in station.camera_names:
        if poil.detector == LABEL_IMAGE and not station.HasOutputPort(f"{name}.label_image"):
            raise label_error(name)


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
        station.camera_models, station.TakeImages(context, labels=labels), station.label_ids
    )

"""Imports a ROS bag as a demonstration, with the camera poses of a scenario."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.errors import ScenarioError
from poil_drake.recording.ros_bag.bag_import import ImportedBag, import_ros_bag


def ImportRosBag(
    bag: str | Path,
    output: str | Path,
    scenario: Scenario,
    *,
    cameras: Mapping[str, str],
    topics: Mapping[str, str] | None = None,
    label_ids: Mapping[str, Sequence[int]] | None = None,
) -> ImportedBag:
    """Imports a ROS bag whose cameras are where the scenario's cameras of the same names are.

    The transforms in the bag are ignored. See `import_ros_bag`.

    Raises:
        ScenarioError: if the scenario does not have one of the cameras.
        DemonstrationError: as in `import_ros_bag`.
    """
    for name in cameras:
        if name not in scenario.cameras:
            raise ScenarioError(
                f"The scenario has no camera '{name}'; it has {', '.join(scenario.cameras)}.",
                remedy=f"Define cameras.{name}, or give the camera in the bag another name.",
            )
    with MakeStation(scenario, ignore_output_delay=True) as station:
        poses = {model.name: model.X_WC for model in station.camera_models}
    return import_ros_bag(
        bag, output, cameras=cameras, topics=topics, label_ids=label_ids, poses=poses
    )

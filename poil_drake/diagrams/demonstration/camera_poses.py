"""The poses of a scenario's cameras, for recordings that lack them."""

from collections.abc import Iterable

import numpy as np

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.errors import ScenarioError


def CameraPoses(scenario: Scenario, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Returns the (4, 4) pose of the optical frame of each named camera in the world [m].

    Raises:
        ScenarioError: if the scenario lacks one of the cameras, or is inconsistent.
    """
    for name in names:
        if name not in scenario.cameras:
            raise ScenarioError(
                f"The scenario has no camera '{name}'; it has {', '.join(scenario.cameras)}.",
                remedy=f"Define cameras.{name}, or give the recorded camera another name.",
            )
    with MakeStation(scenario, ignore_output_delay=True) as station:
        return {model.name: model.X_WC for model in station.camera_models}

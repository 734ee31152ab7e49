"""The poses of a scenario's cameras, for recordings that lack them."""

from collections.abc import Collection

import numpy as np

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import MakeCameraModels
from poil_drake.diagrams.station.station_models import MakeUnsimulatedPlant
from poil_drake.errors import ScenarioError


def CameraPoses(scenario: Scenario, names: Collection[str]) -> dict[str, np.ndarray]:
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
    plant, _, _ = MakeUnsimulatedPlant(scenario)
    cameras = {name: scenario.cameras[name] for name in names}
    return {model.name: model.X_WC for model in MakeCameraModels(plant, cameras)}

"""Chooses a scenario by the options of the command line."""

import dataclasses
from pathlib import Path
from typing import Any

from poil_drake.diagrams.scenario.load import LoadScenario, default_scenario_file
from poil_drake.diagrams.scenario.randomization import ApplyRandomization
from poil_drake.diagrams.scenario.scenario import Scenario


def ChooseScenario(
    *,
    filename: Path | None = None,
    scenario_name: str | None = None,
    data: str | None = None,
    seed: int | None = None,
    tracker: str | None = None,
    detector: str | None = None,
    speed: float | None = None,
    time_scale: float | None = None,
) -> Scenario:
    """Returns a scenario with the values that a user chose; None keeps the scenario's.

    Args:
        filename: The scenario file; None means the package's.
        scenario_name: The scenario of the file.
        data: YAML text merged over it.
        seed: Draws object, pose and noise from the scenario's `randomization`; None draws nothing.
        tracker: Name of the tracker.
        detector: Name of the detector.
        speed: Speed on hardware, see `HardwareConfig`.
        time_scale: Time scale on hardware, see `HardwareConfig`.

    Raises:
        ScenarioError: The scenario cannot be read, or a value is wrong.
    """
    scenario = LoadScenario(
        filename=filename or default_scenario_file(), data=data, scenario_name=scenario_name
    )
    if seed is not None:
        scenario = ApplyRandomization(scenario, seed)
    hardware = _changed(scenario.poil.hardware, speed=speed, time_scale=time_scale)
    poil = _changed(scenario.poil, hardware=hardware, tracker=tracker, detector=detector)
    return dataclasses.replace(scenario, poil=poil)


def _changed(config: Any, **values: Any) -> Any:
    """Returns a config with the values that are not None."""
    return dataclasses.replace(config, **{k: v for k, v in values.items() if v is not None})

"""From what the command line says to a scenario."""

import dataclasses
from pathlib import Path

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
    """Returns the scenario that a user asked for.

    Args:
        filename: The scenario file; None is the package's own.
        scenario_name: Which document of it.
        data: YAML text laid over it.
        seed: Draws the trial of this seed from the scenario's `randomization`: object, pose,
            noise. None leaves the scenario as it is written.
        tracker: In place of the scenario's.
        detector: In place of the scenario's.
        speed: On hardware, in place of the scenario's.
        time_scale: On hardware, in place of the scenario's.

    Raises:
        ScenarioError: in one line, what is wrong and what would be right.
    """
    scenario = LoadScenario(
        filename=filename or default_scenario_file(), data=data, scenario_name=scenario_name
    )
    if seed is not None:
        scenario = ApplyRandomization(scenario, seed)
    hardware = scenario.poil.hardware
    hardware = dataclasses.replace(
        hardware,
        speed=hardware.speed if speed is None else speed,
        time_scale=hardware.time_scale if time_scale is None else time_scale,
    )
    poil = dataclasses.replace(
        scenario.poil,
        hardware=hardware,
        tracker=scenario.poil.tracker if tracker is None else tracker,
        detector=scenario.poil.detector if detector is None else detector,
    )
    return dataclasses.replace(scenario, poil=poil)

"""The pace of the loop on this machine, measured before a run."""

from pathlib import Path

import numpy as np
import pytest
from hardware_bench import hardware_scenario, stand_in, swinging_plan

from poil_drake.diagrams.run import pace_check
from poil_drake.diagrams.run.pace_check import pace_warning
from poil_drake.diagrams.scenario.scenario import Scenario

pytestmark = [pytest.mark.render, pytest.mark.real_time]


def test_the_pace_is_measured_without_commanding_the_robot(
    scenario: Scenario, pictures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[np.ndarray] = []
    measure = pace_check._tick_durations
    monkeypatch.setattr(
        pace_check, "_tick_durations", lambda *args: measured.append(measure(*args)) or measured[-1]
    )
    chosen = hardware_scenario(scenario, time_scale=0.5)
    with stand_in(chosen, pictures, tmp_path, fault="driver_killed") as robot:
        pace_warning(swinging_plan(), chosen)
        robot.process.kill()  # The fault's listener goes on.
        robot.record = {"told": robot._listener_record()}

    (durations,) = measured
    assert len(durations) >= 1
    assert (durations > 0.0).all()
    assert robot.record["told"] == []

"""When a run is sampled, with the real closed loop and without images."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram
from short_skill import short_plan, short_scenario

from poil_drake.diagrams.run import skill_run
from poil_drake.diagrams.run.finished_run import FinishedRun
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.scenario.scenario import Scenario


def execute(scenario: Scenario, **options: object) -> None:
    skill_run.ExecutePlan(
        short_plan(),
        scenario,
        outputs=OutputPaths(),
        show=False,
        show_progress=False,
        check=False,
        **options,
    )


@pytest.mark.parametrize(
    ("tracker", "logger"),
    [(3 / 32, 1 / 16), (1 / 16, 1 / 8), (1 / 8, 1 / 32)],
    ids=["captures between logs", "logs rarer than captures", "a log at each capture"],
)
def test_every_track_is_compared_with_the_truth(
    tracker: float, logger: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    poil = f"{{latency: 1/64, rates: {{tracker: {tracker}, logger: {logger}}}}}"
    scenario = short_scenario(f"{{simulation_duration: 0.375, poil: {poil}}}")
    reports: list[FinishedRun] = []
    monkeypatch.setattr(skill_run, "WriteReport", lambda report, **_: reports.append(report))

    execute(scenario)

    stamps, errors = reports[0].recorder.tracking_errors()
    # All that were captured and released before the end.
    released = [k * tracker for k in range(7) if k * tracker + 1 / 64 < 0.375]
    assert stamps.tolist() == released
    np.testing.assert_allclose(errors, 0.0, atol=1e-9)
    assert set(np.arange(0.0, 0.375, logger)) <= set(reports[0].recorder.times)


@pytest.mark.parametrize(("given", "rate"), [(None, 0.5), (2.0, 2.0), (0.0, 0.0)])
def test_the_simulator_has_the_scenarios_settings_but_the_callers_rate(
    given: float | None, rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulators: list[Simulator] = []

    def make(diagram: Diagram) -> Simulator:
        simulators.append(Simulator(diagram))
        return simulators[-1]

    monkeypatch.setattr(skill_run, "Simulator", make)
    simulator = "{target_realtime_rate: 0.5, max_step_size: 0.004}"
    scenario = short_scenario(f"{{simulation_duration: 0.03125, simulator_config: {simulator}}}")

    execute(scenario, realtime_rate=given)

    assert simulators[0].get_target_realtime_rate() == rate
    assert simulators[0].get_integrator().get_maximum_step_size() == 0.004

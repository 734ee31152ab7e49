"""When a run is looked at, with the real closed loop and without images."""

import numpy as np
import pytest
from short_skill import lasting, short_plan, short_scenario

from poil_drake.diagrams.run import skill_run
from poil_drake.diagrams.run.report import OutputPaths, Report
from poil_drake.diagrams.scenario.load import LoadScenario


@pytest.mark.parametrize(
    ("tracker", "logger"),
    [(3 / 32, 1 / 16), (1 / 16, 1 / 8), (1 / 8, 1 / 32)],
    ids=["captures between logs", "logs rarer than captures", "a log at each capture"],
)
def test_every_track_is_compared_with_the_truth(
    tracker: float, logger: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = LoadScenario(
        data=f"{{poil: {{latency: 1/64, rates: {{tracker: {tracker}, logger: {logger}}}}}}}",
        defaults=lasting(short_scenario(), 0.375),
    )
    reports: list[Report] = []

    def keep(report: Report, **_: object) -> Report:
        reports.append(report)
        return report

    monkeypatch.setattr(skill_run, "WriteReport", keep)
    skill_run.ExecutePlan(
        short_plan(), scenario, outputs=OutputPaths(), show=False, show_progress=False
    )

    stamps, errors = reports[0].recorder.tracking_errors()
    # All that were captured and released before the end.
    released = [k * tracker for k in range(7) if k * tracker + 1 / 64 < 0.375]
    assert stamps.tolist() == released
    np.testing.assert_allclose(errors, 0.0, atol=1e-9)
    assert set(np.arange(0.0, 0.375, logger)) <= set(reports[0].recorder.times)


def test_a_run_is_as_slow_as_the_scenario_or_the_caller_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rates = []

    def make(*args: object, realtime_rate: float | None = None) -> None:
        rates.append(realtime_rate)
        raise KeyboardInterrupt

    monkeypatch.setattr(skill_run, "MakeSimulator", make)
    for given in (None, 0.5):
        with pytest.raises(KeyboardInterrupt):
            skill_run.ExecutePlan(
                short_plan(),
                short_scenario(),
                outputs=OutputPaths(),
                show=False,
                show_progress=False,
                realtime_rate=given,
            )

    assert rates == [None, 0.5]

"""The warning before a run on hardware that this machine is too slow."""

import numpy as np
import pytest

from poil_drake.diagrams.run import pace_check, skill_run
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.pace_check import pace_warning
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.grasping.execution_plan import ExecutionPlan


def warning(
    plan: ExecutionPlan, monkeypatch: pytest.MonkeyPatch, milliseconds: np.ndarray, scale: float
) -> str | None:
    monkeypatch.setattr(pace_check, "_tick_durations", lambda *_: 1e-3 * milliseconds)
    return pace_warning(plan, ChooseScenario(time_scale=scale))


def test_rare_long_periods_give_no_warning(
    plan: ExecutionPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert warning(plan, monkeypatch, np.repeat([2.0, 9.0], [96, 4]), 1.0) is None


def test_a_slow_machine_is_told_the_rate_that_it_keeps(
    plan: ExecutionPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = np.repeat([2.0, 8.0], [90, 10])

    said = warning(plan, monkeypatch, slow, 1.0)

    assert said is not None
    assert "control rate of 256 Hz" in said
    assert "takes 8.0 ms or more, so it keeps 125 Hz" in said
    assert warning(plan, monkeypatch, slow, 0.25) is None  # A period of 15.6 ms.


def test_a_run_on_hardware_prints_the_warning_before_the_loop_is_built(
    plan: ExecutionPlan, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    class BuiltError(Exception):
        pass

    def build(*args: object, **kwargs: object) -> None:
        raise BuiltError

    monkeypatch.setattr(skill_run, "pace_warning", lambda plan, scenario: "too slow.")
    monkeypatch.setattr(skill_run, "MakeClosedLoop", build)

    with pytest.raises(BuiltError):
        skill_run.ExecutePlan(
            plan, ChooseScenario(), outputs=OutputPaths(), hardware=True, show=False, check=False
        )

    assert "warning: too slow.\n" in capsys.readouterr().out

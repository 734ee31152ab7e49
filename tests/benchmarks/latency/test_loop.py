"""Where the time of a simulated run goes."""

import json
import time
from pathlib import Path

import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.benchmarks.latency import loop
from poil_drake.benchmarks.latency.loop import run_loop_benchmark, timed_systems
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.reports.run_summary import RunSummary, RunTiming


class Source(LeafSystem):
    def __init__(self):
        super().__init__()
        self.DeclareVectorOutputPort("out", 1, self._calc)

    def _calc(self, context, output):
        time.sleep(0.02)


class Reader(LeafSystem):
    def __init__(self):
        super().__init__()
        self._input = self.DeclareVectorInputPort("in", 1)
        self.DeclarePeriodicPublishEvent(0.25, 0.0, self._publish)

    def _publish(self, context):
        self._input.Eval(context)
        time.sleep(0.002)


def test_a_system_is_not_charged_for_the_outputs_of_others() -> None:
    with timed_systems() as spent:
        builder = DiagramBuilder()
        source, reader = builder.AddSystem(Source()), builder.AddSystem(Reader())
        builder.Connect(source.get_output_port(), reader.get_input_port())
        simulator = Simulator(builder.Build())
    simulator.Initialize()
    simulator.AdvanceTo(0.5)

    # The port depends on the time, so it is computed at 0, 0.25 and 0.5 s.
    assert spent["Source"] >= 3 * 0.02
    assert 3 * 0.002 <= spent["Reader"] < spent["Source"]


def test_systems_built_later_are_not_timed() -> None:
    before = LeafSystem.DeclarePeriodicPublishEvent
    with timed_systems():
        assert LeafSystem.DeclarePeriodicPublishEvent is not before

    assert LeafSystem.DeclarePeriodicPublishEvent is before


def test_the_split_is_printed_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    timing = RunTiming(
        simulated=2.0,
        wall=4.0,
        parts={"control": 1.0, "physics": 3.0},
        concurrent={"rendering": 2.0},
        stages={"planning": 5.0},
    )
    summary = RunSummary(success=True, reason="", timing=timing)
    monkeypatch.setattr(loop, "RunSkill", lambda *args, **kwargs: summary)

    run_loop_benchmark(scenario=ChooseScenario(), json_path=tmp_path / "loop.json")

    written = json.loads((tmp_path / "loop.json").read_text())
    assert written["real_time_factor"] == 0.5
    assert written["systems"] == {"Drake": 4.0}
    printed = capsys.readouterr().out
    assert "2.0 s simulated in 4.0 s (0.50x real time)" in printed
    lines = [line.split() for line in printed.splitlines()]
    assert ["physics", "3.00", "75.0", "%"] in lines
    assert ["planning", "5.00", "125.0", "%"] in lines

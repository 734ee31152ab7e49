"""A run that ends early leaves readable outputs that say why."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from short_skill import short_plan, short_scenario
from stopped_run import SAMPLES

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.recorder import RunRecorder
from poil_drake.diagrams.run.skill_run import ExecutePlan, RunSkill
from poil_drake.diagrams.scenario.load import ChooseScenario, DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import PoilError
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.reports.run_summary import RunSummary
from poil_drake.systems.skill import sequencer as skill_sequencer

SCRIPT = Path(__file__).parent / "stopped_run.py"
PERIOD = 1 / 32


def read_log(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Returns the JSON records of a finished log, by topic."""
    records: dict[str, list[dict[str, Any]]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_summary() is not None  # the index and the footer are there
        for _, channel, message in reader.iter_messages():
            known = records.setdefault(channel.topic, [])
            if channel.message_encoding == "json":
                known.append(json.loads(message.data))
    return records


def execute(
    folder: Path, scenario: Scenario | None = None, *, check: bool = False
) -> tuple[RunSummary, OutputPaths]:
    outputs = OutputPaths.under(folder)
    chosen = scenario or short_scenario("{simulation_duration: 2}")
    summary = ExecutePlan(
        short_plan(), chosen, outputs=outputs, show=False, show_progress=False, check=check
    )
    return summary, outputs


@pytest.fixture(scope="module")
def failed_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunSummary, OutputPaths]:
    return execute(tmp_path_factory.mktemp("failed"))


@pytest.mark.parametrize(
    ("number", "status", "said", "reason"),
    [
        (signal.SIGTERM, 143, "poil: terminated", "terminated"),
        (signal.SIGINT, 130, "poil: stopped by the user", "stopped by the user"),
    ],
)
def test_a_signal_ends_the_run_with_its_status_and_complete_outputs(
    tmp_path: Path, number: int, status: int, said: str, reason: str
) -> None:
    short_plan().save(tmp_path / "plan.npz")
    (tmp_path / "scenario.yaml").write_text(DumpScenario(short_scenario()))
    arguments = ["execute", "plan.npz", "scenario.yaml", "--no-meshcat"]

    command = [sys.executable, str(SCRIPT), str(int(number)), *arguments]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

    assert run.returncode == status, run.stderr
    assert run.stderr.splitlines()[-1] == said
    assert "Traceback" not in run.stderr
    figures = json.loads((tmp_path / "out" / "run.json").read_text())
    assert (figures["success"], figures["reason"]) == (False, reason)
    # The signal arrives during a sample, between two steps.
    assert figures["timing"]["simulated"] == (SAMPLES - 1) * PERIOD
    assert figures["phases"][0]["name"] == "wait"
    log = read_log(tmp_path / "out" / "run.mcap")
    assert len(log["/skill/status"]) == SAMPLES
    assert (tmp_path / "out" / "run.png").stat().st_size > 10_000


def test_an_exception_in_the_loop_ends_with_a_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = skill_sequencer.next_state

    def next_state(state: Any, seen: Any, config: Any) -> Any:
        if seen.time >= 0.25:
            raise RuntimeError("the state machine\n  is broken")
        return original(state, seen, config)

    monkeypatch.setattr(skill_sequencer, "next_state", next_state)

    summary, outputs = execute(tmp_path)

    assert not summary.success
    assert summary.reason == "RuntimeError: the state machine is broken"
    assert json.loads(outputs.json.read_text())["reason"] == summary.reason
    assert len(read_log(outputs.mcap)["/skill/status"]) == 0.25 / PERIOD + 1
    assert outputs.png.exists()


def test_a_fault_is_in_every_output(failed_run: tuple[RunSummary, OutputPaths]) -> None:
    summary, outputs = failed_run

    assert summary.reason == "the fingers closed on nothing (in phase 'grasp')"
    log = read_log(outputs.mcap)
    assert [(r["phase"], r["reason"]) for r in log["/phase"]] == [
        ("wait", "the run has begun"),
        ("approach", "the tracker follows the object"),
        ("descend", "the approach has ended"),
        ("grasp", "the descent has ended"),
        ("fault", "the fingers closed on nothing"),
    ]
    last = log["/skill/status"][-1]
    assert (last["fault"], last["fault_text"]) == (2.0, "the fingers closed on nothing")
    robot = log["/robot/status"][-1]
    assert (robot["mode"], robot["mode_text"]) == (2.0, "move")
    assert 0.0 <= robot["age"] < 0.05
    assert log["/tracker/status"][-1]["status_text"] == "tracking"
    assert "/disturbances/status" not in log


def test_disturbances_are_logged_with_their_bodies(tmp_path: Path) -> None:
    pulse = "{body: 'mug::body', start: 1/8, duration: 1/8, force: [0, 0.5, 0]}"
    scenario = short_scenario(f"{{poil: {{disturbances: [{pulse}]}}}}")
    with RunLogWriter(tmp_path / "run.mcap") as log:
        loop = MakeClosedLoop(scenario, short_plan(), log=log)
        Simulator(loop.diagram).AdvanceTo(0.5)

    records = read_log(tmp_path / "run.mcap")["/disturbances/status"]

    # At 5/32, 6/32 and 7/32 s: sin 45, 90 and 135 degrees; the last record ends the push.
    pushes = [[push["force"][1] for push in record["applied"]] for record in records]
    rise = pytest.approx(0.5 * 0.5**0.5)
    assert pushes == [[rise], [pytest.approx(0.5)], [rise], []]
    assert records[0]["applied"][0]["body"] == "mug::body"


def test_old_outputs_are_removed_even_if_the_plan_does_not_fit(tmp_path: Path) -> None:
    wrong = short_scenario("{poil: {part: spout}}")
    outputs = OutputPaths.under(tmp_path)
    outputs.png.touch()
    outputs.mcap.touch()

    with pytest.raises(PoilError, match="spout"):
        execute(tmp_path, wrong, check=True)

    assert not outputs.png.exists()
    assert read_log(outputs.mcap) == {}
    figures = json.loads(outputs.json.read_text())
    assert figures["success"] is False
    assert "spout" in figures["reason"]


@pytest.mark.parametrize(
    ("text", "hardware", "says"),
    [
        ("{poil: {detector: magic}}", False, "magic"),
        ("{}", True, "ground_truth' needs the simulator's poses, which hardware does not have"),
    ],
)
def test_a_job_that_cannot_start_leaves_its_figures(
    tmp_path: Path, text: str, hardware: bool, says: str
) -> None:
    wrong, outputs = short_scenario(text), OutputPaths.under(tmp_path)

    with pytest.raises(PoilError, match=says):
        RunSkill(wrong, outputs=outputs, hardware=hardware, show=False)

    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]
    figures = json.loads((tmp_path / "run.json").read_text())
    assert figures["success"] is False
    assert says in figures["reason"]
    assert figures["versions"]["drake"]


def test_the_stages_and_the_parts_of_a_run_are_measured(
    failed_run: tuple[RunSummary, OutputPaths],
) -> None:
    summary, outputs = failed_run

    timing = json.loads(outputs.json.read_text())["timing"]
    assert timing["stages"].keys() == {"execution", "report"}
    assert timing["stages"]["execution"] >= timing["wall"]
    parts = timing["parts"]
    assert parts["publishing"] > 0.0
    assert parts["control"] > 0.0
    # Without cameras and a tracker process there is nothing to capture or to wait for.
    assert parts["capture"] == parts["detection"] == parts["waiting"] == 0.0
    assert timing["concurrent"] == {"rendering": 0.0, "tracking": 0.0}
    assert sum(parts.values()) == pytest.approx(timing["wall"])
    assert summary.timing.stages == timing["stages"]


@pytest.mark.render
def test_a_run_whose_camera_process_dies_reports_it_and_leaves_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sample = RunRecorder.sample

    def kill_the_cameras(self: RunRecorder, root: Context) -> None:
        if root.get_time() == 0.5:
            process = self.loop.station._camera_process
            os.kill(process.pid, signal.SIGKILL)
        sample(self, root)

    monkeypatch.setattr(RunRecorder, "sample", kill_the_cameras)

    summary, outputs = execute(tmp_path, ChooseScenario())

    assert not summary.success
    assert "cameras' process has ended with status -9" in summary.reason
    assert json.loads(outputs.json.read_text())["reason"] == summary.reason
    assert "/camera/left/image" in read_log(outputs.mcap)

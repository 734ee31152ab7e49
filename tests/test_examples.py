"""Every example runs and does what its docstring says; the README shows the first one."""

import re
from pathlib import Path

import pytest
from python_process import run_python

from poil_drake.recording.run_log.reader import load_recorded_run

ROOT = Path(__file__).parent.parent
FIRST_DIAGRAM = (ROOT / "examples" / "first_diagram.py").read_text()
PRINT_MOTION = """
    station = loop.station
    context = station.GetMyContextFromRoot(simulator.get_context())
    for name in ("panda.position_measured", "panda.velocity_measured"):
        print(*station.GetOutputPort(name).Eval(context))
"""
FOLLOWING = 7.0  # [s]: at this time tracked points move the arm and the mug.
AS_FAST_AS_POSSIBLE = """
import runpy, sys
from pydrake.systems.analysis import Simulator
Simulator.set_target_realtime_rate = lambda self, rate: None
runpy.run_path(sys.argv[1], run_name="__main__")
"""


def run_example(name: str, *arguments: object, cwd: Path) -> str:
    """Runs an example in its own process and returns its output."""
    return run_python(ROOT / "examples" / name, *arguments, cwd=cwd)


def test_every_example_is_run_by_a_test() -> None:
    tests = [Path(__file__), ROOT / "tests" / "hardware" / "test_dry_run_example.py"]
    texts = "".join(path.read_text() for path in tests)

    names = [path.name for path in (ROOT / "examples").glob("*.py")]

    assert len(names) >= 8
    assert [name for name in names if f'"{name}"' not in texts] == []


def test_the_readmes_first_diagram_is_the_example() -> None:
    readme = (ROOT / "README.md").read_text()
    example = FIRST_DIAGRAM.split("\n\n", 1)[1]
    indented = "\n".join(f"    {line}" if line else "" for line in example.strip().splitlines())
    assert indented in readme


@pytest.mark.slow
@pytest.mark.render
def test_the_example_moves_exactly_as_the_run_of_another_process(
    tmp_path: Path, whole_run: Path, demonstration: Path
) -> None:
    # The two processes differ in hash seeds, memory addresses and timing.
    run = load_recorded_run(whole_run / "run.mcap")
    assert 12.0 < run.end <= 16.0
    assert {phase.name: phase.time for phase in run.phases}["follow"] < FOLLOWING - 0.5
    assert FIRST_DIAGRAM.count("AdvanceTo(16.0)") == 1
    script = FIRST_DIAGRAM.replace("AdvanceTo(16.0)", f"AdvanceTo({FOLLOWING})")

    page, *motion = run_python("-c", script + PRINT_MOTION, cwd=tmp_path).splitlines()

    assert page.startswith("http://localhost:")
    found = [float(number) for line in motion for number in line.split()]
    assert found == run.joints.at(FOLLOWING)[:14].tolist()
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["demo.mcap"]
    recorded = [tmp_path / "out" / "demo.mcap", whole_run / "demo.mcap", demonstration]
    assert len({path.read_bytes() for path in recorded}) == 1


@pytest.mark.parametrize("flags", [[], ["--meshcat"]])
def test_the_controller_alone_takes_the_body_to_the_goal(flags: list[str], tmp_path: Path) -> None:
    path = ROOT / "examples" / "controller_alone.py"
    output = run_python("-c", AS_FAST_AS_POSSIBLE, path, *flags, cwd=tmp_path)

    errors = [float(e) for e in re.findall(r"^\d s: +([\d.]+) mm", output, re.MULTILINE)]
    assert len(errors) == 9
    assert errors[0] > 1000.0
    # At 3 / s a few mm decay within a second or two; the integrator's error is below 0.1 mm.
    assert errors[-1] <= 0.1
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_users_own_tracker_hangs_the_mug(plan_file: Path, tmp_path: Path) -> None:
    output = run_example("own_tracker.py", plan_file, cwd=tmp_path)

    assert "done" in output
    (error,) = re.findall(r"release, ([\d.]+) mm", output)
    # A millimetre of noise on each coordinate is √3 mm; the gripper follows it slowly.
    assert 0.0 < float(error) < 5.0


@pytest.mark.slow
def test_a_users_own_station_reports_contacts(plan_file: Path, tmp_path: Path) -> None:
    output = run_example("own_station.py", plan_file, cwd=tmp_path)

    touched = set(output.removeprefix("touched something: ").strip().split(", "))
    assert {"rack::rod", "mug::handle", "table::table"} <= touched
    assert "box::box" not in touched


@pytest.mark.slow
@pytest.mark.render
def test_a_log_is_read(whole_run: Path, tmp_path: Path) -> None:
    output = run_example("reading_a_log.py", whole_run / "run.mcap", cwd=tmp_path)

    assert re.findall(r"s: (\w+)$", output, re.MULTILINE)[-1] == "done"
    assert "camera 'left': " in output
    # Tracks are released 3/16 s after their capture, and logged at once.
    assert re.search(r"\d+ tracks, 1\d\d ms old", output)


@pytest.mark.slow
def test_trials_run_side_by_side(plan_file: Path, tmp_path: Path) -> None:
    output = run_example("batch_of_trials.py", plan_file, "0", "30", cwd=tmp_path)

    found = {int(n): float(mm) for n, mm in re.findall(r"(\d+) N: ([\d.]+) mm", output)}
    assert found.keys() == {0, 30}
    assert 0.0 < found[0] < found[30] < 10.0


@pytest.mark.slow
@pytest.mark.render
def test_a_users_own_task_succeeds(tmp_path: Path) -> None:
    # The ground-truth tracker saves the time of rendering.
    script = (ROOT / "examples" / "own_task.py").read_text()
    assert script.count('TASK = """\n') == 1
    script = script.replace('TASK = """\n', 'TASK = """\npoil: {tracker: ground_truth}\n')

    output = run_python("-c", script, "own", cwd=tmp_path)

    assert output.startswith("SUCCESS: the mug hangs on the rack")
    assert {path.name for path in (tmp_path / "own").iterdir()} >= {"demo.mcap", "run.mcap"}

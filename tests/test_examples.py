"""Every example runs and does what its docstring says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
AS_FAST_AS_POSSIBLE = """
import runpy, sys
from pydrake.systems.analysis import Simulator
Simulator.set_target_realtime_rate = lambda self, rate: None
runpy.run_path(sys.argv[1], run_name="__main__")
"""


def run_python(*arguments: object, cwd: Path) -> str:
    """Runs Python in its own process and returns its output."""
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def run_example(name: str, *arguments: object, cwd: Path) -> str:
    return run_python(ROOT / "examples" / name, *arguments, cwd=cwd)


def test_every_example_is_run_by_a_test() -> None:
    tests = [ROOT / "tests" / name for name in ("test_examples.py", "test_readme.py")]
    tests.append(ROOT / "tests" / "hardware" / "test_dry_run_example.py")
    texts = "".join(path.read_text() for path in tests)

    names = [path.name for path in (ROOT / "examples").glob("*.py")]

    assert len(names) >= 8
    assert [name for name in names if f'"{name}"' not in texts] == []


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

"""Shared fixtures: one demonstration, one plan and one run, made once for all processes."""

import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings
from typer.testing import CliRunner

if TYPE_CHECKING:  # Slow to import.
    from poil_drake.diagrams.scenario.scenario import Scenario
    from poil_drake.grasping.execution_plan import ExecutionPlan
    from poil_drake.robots.panda_kinematics import PandaModel

MakeOnce = Callable[[str, Callable[[Path], object]], Path]

# Tests do not depend on the machine's speed.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


@pytest.fixture(scope="session")
def scenario() -> "Scenario":
    """The package's own scenario, as `poil run` has it."""
    from poil_drake.diagrams.scenario.load import ChooseScenario

    return ChooseScenario()


@pytest.fixture(scope="session")
def model() -> "PandaModel":
    from poil_drake.robots.panda_kinematics import PandaModel

    return PandaModel()


@pytest.fixture(scope="session")
def make_once(tmp_path_factory: pytest.TempPathFactory) -> MakeOnce:
    """Returns a function that makes a shared path once, in whichever process needs it first."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent

    def make_once(name: str, make: Callable[[Path], object]) -> Path:
        path, unfinished = folder / name, folder / f"unfinished_{name}"
        with (folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                shutil.rmtree(unfinished, ignore_errors=True)  # Left by a process that failed.
                make(unfinished)
                unfinished.rename(path)
        return path

    return make_once


@pytest.fixture(scope="session")
def demonstration(make_once: MakeOnce) -> Path:
    """The built-in demonstration, written by `poil demo record`."""

    def record(path: Path) -> None:
        assert poil(["demo", "record", "-o", str(path)]).endswith(f"frames to {path}\n")

    return make_once("demo.mcap", record)


@pytest.fixture(scope="session")
def plan_file(demonstration: Path, make_once: MakeOnce) -> Path:
    """The plan of `poil transfer` that hangs the package's own mug as demonstrated."""

    def transfer(path: Path) -> None:
        said = poil(["transfer", str(demonstration), "-o", str(path)])
        page = path.with_suffix(".html")
        assert said == f"wrote the plan to {path}\nwrote a page that shows it to {page}\n"
        page.rename(page.with_name("plan.html"))

    return make_once("plan.npz", transfer)


@pytest.fixture(scope="session")
def plan(plan_file: Path) -> "ExecutionPlan":
    """The plan in `plan_file`."""
    from poil_drake.grasping.execution_plan import ExecutionPlan

    return ExecutionPlan.load(plan_file)


@pytest.fixture(scope="session")
def whole_run(make_once: MakeOnce) -> Path:
    """The folder of outputs of `poil run`, with stations that have no label ports."""

    def run(folder: Path) -> None:
        folder.mkdir()
        program = Path(__file__).with_name("poil_without_labels.py")
        command = [sys.executable, program, "run"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    return make_once("whole_run", run) / "out"


def poil(arguments: Sequence[str]) -> str:
    """Runs a command of `poil` in this process and returns its output."""
    from poil_drake.cli import app

    done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--write-fault-table",
        action="store_true",
        help="Write docs/hardware_faults.md from the results of tests/hardware.",
    )
    parser.addoption(
        "--time-scale",
        type=float,
        help="The robot's seconds per second in tests/hardware; default: found by a trial run.",
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leaves out files without tests in real time when only these are run: imports take long."""
    wanted = config.getoption("markexpr") == "real_time" and collection_path.suffix == ".py"
    return True if wanted and "mark.real_time" not in collection_path.read_text() else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts files with whole runs first, so that none of them starts late and runs on alone."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)

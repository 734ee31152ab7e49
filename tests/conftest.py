"""What whole runs share: one demonstration, one plan, recorded and made once a session."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from poil_drake.diagrams.demonstration_recorder import RecordDemonstration
from poil_drake.diagrams.planning import PlanScenario
from poil_drake.diagrams.scenario import Scenario
from poil_drake.diagrams.scenario_choice import ChooseScenario
from poil_drake.grasping.execution_plan import ExecutionPlan

# How fast a machine is decides no test.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """The package's own scenario, as `poil run` has it."""
    return ChooseScenario()


@pytest.fixture(scope="session")
def demonstration(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built-in demonstration."""
    path = tmp_path_factory.mktemp("demonstration") / "demo.mcap"
    RecordDemonstration(scenario, path)
    return path


@pytest.fixture(scope="session")
def plan(scenario: Scenario, demonstration: Path) -> ExecutionPlan:
    """The plan to hang the package's own mug as the demonstration shows."""
    return PlanScenario(scenario, demonstration)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--write-fault-table",
        action="store_true",
        help="Write docs/hardware_faults.md from what tests/hardware finds.",
    )
    parser.addoption(
        "--time-scale",
        type=float,
        help="The robot's seconds per second in tests/hardware; else as the machine permits.",
    )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts files with whole runs first, so that no process is left alone with them at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)

"""Opens the log of a run, with everything that a replay needs to start."""

from collections.abc import Mapping
from pathlib import Path

from poil_drake.diagrams.scenario.load import DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.run_log.layout import SIMULATED, STATION_KEY
from poil_drake.recording.run_log.writer import RunLogConfig, RunLogWriter


def OpenRunLog(
    path: Path,
    *,
    plan: ExecutionPlan,
    scenario: Scenario,
    station: str = SIMULATED,
    metadata: Mapping[str, str] | None = None,
    config: RunLogConfig | None = None,
) -> RunLogWriter:
    """Opens the log of a run. The caller closes it.

    Args:
        path: The log's file.
        plan: The plan that is executed; the log contains it.
        scenario: The scenario of the run; the log contains it.
        station: The kind of station: `SIMULATED`, `HARDWARE` or `DRY_RUN`.
        metadata: More entries for the log's metadata.
        config: How to log; None chooses the settings for the kind of station.
    """
    if config is None:
        config = RunLogConfig() if station == SIMULATED else RunLogConfig.for_hardware()
    poil = scenario.poil
    about = {
        **{key: str(value) for key, value in plan.metadata.items()},
        "scenario": scenario.source.name,
        "scenario_file": scenario.source.file,
        "object": poil.object,
        "part": poil.part,
        "fixture": poil.fixture,
        "tracker": poil.tracker,
        "seed": str(scenario.random_seed),
        STATION_KEY: station,
        **(metadata or {}),
    }
    return RunLogWriter(
        path,
        metadata=about,
        scenario_text=DumpScenario(scenario),
        plan=plan.to_bytes(),
        config=config,
    )

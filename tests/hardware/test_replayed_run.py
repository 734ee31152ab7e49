"""The log of a real robot's run is replayed without the robot."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest
from hardware_bench import execute, hardware_scenario, swinging_plan
from machine_pace import Pace

from poil_drake.diagrams.replay.replay import Replay
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.recording.comparison.tolerances import JOINT_VELOCITY, TRACKED_POINTS
from poil_drake.recording.run_log.reader import load_recorded_run

pytestmark = [pytest.mark.render, pytest.mark.real_time]

SPEED = 1.0


@pytest.fixture(scope="module")
def log(
    scenario: Scenario,
    run_that_keeps_up: Callable,
    pictures: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, str]:
    """The log of a run against the stand-in robot, and its reason.

    The cameras' images do not change; the run ends two seconds after it begins to follow.
    """
    folder = tmp_path_factory.mktemp("hardware")

    def attempt(time_scale: float) -> tuple[tuple[Path, str], Pace]:
        chosen = hardware_scenario(scenario, speed=SPEED, time_scale=time_scale)
        chosen = dataclasses.replace(chosen, simulation_duration=4.25)
        summary, record = execute(swinging_plan(), chosen, pictures, folder)
        return (folder / "run.mcap", summary.reason), record.pace(summary.to_dict(), chosen)

    return run_that_keeps_up(attempt)


@pytest.mark.parametrize("tracker", ["recorded", None])
def test_a_replay_commands_what_the_run_commanded(
    log: tuple[Path, str], tracker: str | None
) -> None:
    path, reason = log
    run = load_recorded_run(path)
    assert "follow" in {phase.name for phase in run.phases}, reason

    summary = Replay(path, tracker=tracker, show_progress=False)

    assert summary.station == "hardware"
    assert summary.same, summary.closing_line()
    commands = summary.comparison.statistics_by_phase(JOINT_VELOCITY)
    # Until the arm follows the points, they decide only when the approach begins. Everything else
    # is exact in the log, including the time of each message.
    phases = list(commands)
    exact = phases if tracker == "recorded" else phases[: phases.index("follow")]
    assert {name: commands[name].maximum for name in exact} == dict.fromkeys(exact, 0.0)
    assert commands["approach"].count > 64
    assert run.commands.values[:, 0].max() > 0.02
    assert summary.comparison.tracks.unmatched == 0
    tracks = summary.comparison.statistics_by_phase(TRACKED_POINTS)["follow"]
    assert tracks.count > 4
    assert tracks.maximum < 0.005

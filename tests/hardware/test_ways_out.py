"""However a run ends while the arm moves, the arm comes to rest and the outputs are written."""

import json
import math
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hardware_bench import RobotRecord, StandIn, hardware_scenario, stand_in
from machine_pace import KEPT, Pace
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from poil_drake.benchmarks.hardware.stand_in_robot import wait_until_ready
from poil_drake.diagrams.scenario.load import DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.systems.safety.faults import SafetyFault

pytestmark = [pytest.mark.render, pytest.mark.real_time]

HERE = Path(__file__).parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(HERE.parent)}
REST = 0.15
FAST = 0.2  # [rad/s]: the swing is well on its way.
STALLED = SafetyFault.LOOP_STALLED.text
ActOnRun = Callable[..., "Run"]


class Run:
    """A run in its own process, against a stand-in robot in another one.

    Attributes:
        scenario: The scenario that it runs.
        folder: The folder of its outputs.
        acted_at: Time of the first signal to it [s since the epoch, by the robot's clock].
        lag: The longest delay of a signal or a sleep in this process [s of the robot's time].
        status: Its exit status.
        output: Its standard output and standard error.
        record: The robot's record.
    """

    status: int
    output: tuple[str, str]
    record: RobotRecord

    def __init__(self, robot: StandIn, scenario: Scenario, folder: Path):
        self.robot, self.scenario, self.folder = robot, scenario, folder
        self.clock = scenario.poil.hardware.clock()
        self.acted_at, self.lag = math.inf, 0.0
        text = folder / "scenario.yaml"
        text.write_text(DumpScenario(scenario))
        self.process = subprocess.Popen(
            command(text, folder),
            env=ENVIRONMENT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def sleep(self, duration: float) -> None:
        """Sleeps for a duration of the robot's time [s]."""
        end = self.clock() + duration
        time.sleep(duration / self.scenario.poil.hardware.time_scale)
        self.lag = max(self.lag, self.clock() - end)

    def becomes_fast(self) -> bool:
        """Waits until its arm is fast; returns False if the run ends before."""
        stdout = self.robot.process.stdout
        while not select.select([stdout], [], [], 0.1)[0]:
            if self.process.poll() is not None:
                return False
        assert stdout.readline() == "moving\n"
        self.sleep(0.5)
        return True

    def send(self, number: int) -> None:
        """Sends a signal."""
        now = self.clock()
        self.process.send_signal(number)
        self.acted_at = min(self.acted_at, now)
        self.lag = max(self.lag, self.clock() - now)

    def finish(self) -> None:
        """Waits until the run has ended."""
        self.output = self.process.communicate()
        self.status = self.process.returncode
        self.record = RobotRecord(**self.robot.finish())

    @property
    def figures(self) -> dict:
        return json.loads((self.folder / "run.json").read_text())

    @property
    def log(self) -> Path:
        return self.folder / "run.mcap"


def command(scenario: Path, folder: Path) -> list[str]:
    return [sys.executable, str(HERE / "executed_run.py"), str(scenario), str(folder)]


@pytest.fixture
def act_on_run(
    scenario: Scenario, run_that_keeps_up: Callable, pictures: Path, tmp_path: Path
) -> ActOnRun:
    """Acts on a run while the arm moves, and returns the run once it has ended.

    `act_on_run(act, figures=)` calls `act(run)`; `figures` states whether the run leaves figures
    that show how well it kept up.
    """

    def act_on_run(act: Callable[[Run], None], *, figures: bool = True) -> Run:
        def attempt(time_scale: float) -> tuple[Run, Pace]:
            chosen = hardware_scenario(scenario, time_scale=time_scale)
            folder = Path(tempfile.mkdtemp(dir=tmp_path))
            with stand_in(chosen, pictures, folder, wait=False) as robot:
                run = Run(robot, chosen, folder)  # Starts meanwhile.
                try:
                    wait_until_ready(robot.process)
                    fast = run.becomes_fast()
                    if fast:
                        act(run)
                    run.finish()
                finally:
                    if run.process.poll() is None:
                        run.process.kill()
                        run.process.communicate()
            pace = run.record.pace(run.figures if figures or not fast else None, chosen)
            if not fast:
                # Only a process that was held up ends a run that early.
                assert STALLED in run.figures["reason"] or pace.lag > KEPT.lag, run.output
                return run, Pace(math.inf)
            return run, pace._replace(lag=max(pace.lag, run.lag))

        return run_that_keeps_up(attempt)

    return act_on_run


def is_whole(log: Path) -> bool:
    with log.open("rb") as stream:
        return make_reader(stream).get_summary() is not None


def was_commanded_to_rest(run: Run) -> bool:
    """Returns whether rest was commanded for longer than the driver follows a command."""
    told = [time for time, speed in run.record.told if speed == 0.0]
    return max(told, default=0.0) - run.acted_at > run.scenario.poil.hardware.command_expiry


@pytest.mark.parametrize(
    ("number", "status", "reason"),
    [
        (signal.SIGINT, 130, "stopped by the user"),
        (signal.SIGTERM, 143, "terminated"),
        (signal.SIGHUP, 129, "the terminal was closed"),
    ],
)
def test_a_signal_brings_the_arm_to_rest(
    act_on_run: ActOnRun, number: int, status: int, reason: str
) -> None:
    run = act_on_run(lambda run: run.send(number))

    assert run.status == status, run.output
    assert [speed for time, speed in run.record.speeds if time < run.acted_at][-1] > FAST
    assert run.record.rest_after(run.acted_at) <= REST
    assert was_commanded_to_rest(run)
    assert run.figures["reason"] == reason
    assert is_whole(run.log)


def test_an_impatient_user_does_not_keep_the_arm_from_resting(act_on_run: ActOnRun) -> None:
    def interrupt_repeatedly(run: Run) -> None:
        for _ in range(6):
            run.send(signal.SIGINT)
            run.sleep(0.02)

    run = act_on_run(interrupt_repeatedly)

    assert run.status != 0
    assert run.record.rest_after(run.acted_at) <= REST
    assert was_commanded_to_rest(run)


def test_a_run_that_is_suspended_and_resumed_leaves_the_arm_at_rest(act_on_run: ActOnRun) -> None:
    def suspend_and_resume(run: Run) -> None:
        run.send(signal.SIGSTOP)
        run.sleep(1.0)
        run.send(signal.SIGCONT)

    run = act_on_run(suspend_and_resume, figures=False)

    assert run.status == 1
    # The driver's expiry of 0.1 s, and the low pass.
    assert run.record.rest_after(run.acted_at, commands=False) <= 0.1 + REST
    assert run.figures["reason"].startswith(STALLED)
    assert is_whole(run.log)


def times_of(log: Path) -> list[float]:
    """Returns the log times [s] of the messages of a log, as far as it can be read."""
    times: list[float] = []
    with log.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                times += [record.log_time * 1e-9] if hasattr(record, "log_time") else []
        except (McapError, EOFError):
            pass
    return times


def test_a_run_that_is_killed_leaves_a_readable_log(act_on_run: ActOnRun) -> None:
    def kill(run: Run) -> None:
        run.send(signal.SIGKILL)
        run.sleep(0.5)

    run = act_on_run(kill, figures=False)

    assert run.status == -signal.SIGKILL
    assert run.record.rest_after(run.acted_at, commands=False) <= 0.1 + REST
    commanded = run.record.commanded
    # The log begins with the loop, and lacks its last, incomplete chunk (64 kB).
    assert max(times_of(run.log)) > commanded[-1] - commanded[0] - 0.5


def test_a_second_run_refuses_to_command_beside_the_first(act_on_run: ActOnRun) -> None:
    ended = []

    def run_another(run: Run) -> None:
        folder = run.folder / "second"
        folder.mkdir()
        second = command(run.folder / "scenario.yaml", folder)
        ended.append(
            subprocess.run(second, env=ENVIRONMENT, capture_output=True, text=True, check=False)
        )
        run.send(signal.SIGINT)

    first = act_on_run(run_another)

    assert ended[-1].returncode != 0
    assert "Another process commands the robot" in ended[-1].stderr
    reason = json.loads((first.folder / "second" / "run.json").read_text())["reason"]
    assert "another process commands" in reason.lower()

"""However a run ends while the arm moves: the arm rests, and the outputs are there."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hardware_bench import Seen, StandIn, hardware_scenario, stand_in
from machine_pace import Pace, first_kept, repeated
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from poil_drake.diagrams.dump_scenario import DumpScenario
from poil_drake.diagrams.scenario import Scenario
from poil_drake.systems.safety_faults import SAFETY_FAULT_TEXT, SafetyFault

pytestmark = [pytest.mark.render, pytest.mark.real_time]

HERE = Path(__file__).parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(HERE.parent)}
REST = 0.15
FAST = 0.2  # [rad/s]: the swing is well on its way.
Stop = Callable[..., "Run"]


class Run:
    """A run in a process of its own, against a stand-in robot in another one.

    Attributes:
        scenario: What is run.
        folder: Where its outputs are.
        acted_at: When something was done to it [s since the epoch, by the robot's clock].
        status: The status it ended with.
        said: What it wrote to standard output and error.
        seen: What the robot saw.
    """

    acted_at: float
    status: int
    said: tuple[str, str]
    seen: Seen

    def __init__(self, robot: StandIn, scenario: Scenario, folder: Path):
        self.robot, self.scenario, self.folder = robot, scenario, folder
        self.clock = scenario.poil.hardware.clock()
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
        """Sleeps for some of the robot's time [s]."""
        time.sleep(duration / self.scenario.poil.hardware.time_scale)

    def wait_until_it_moves(self) -> None:
        """Waits for the stand-in's word, and then until its arm is fast."""
        said = self.robot.process.stdout
        assert said is not None
        while not select.select([said], [], [], 0.1)[0]:
            # It may have ended for a reason of its own.
            assert self.process.poll() is None, self.process.communicate()
        assert said.readline() == "moving\n"
        self.sleep(0.5)

    def send(self, number: int) -> None:
        """Sends a signal."""
        self.process.send_signal(number)

    def finish(self) -> None:
        """Waits for the end."""
        self.said = self.process.communicate()
        self.status = self.process.returncode
        self.seen = Seen(**self.robot.finish())

    @property
    def figures(self) -> dict:
        return json.loads((self.folder / "run.json").read_text())

    @property
    def log(self) -> Path:
        return self.folder / "run.mcap"


def command(scenario: Path, folder: Path) -> list[str]:
    return [sys.executable, str(HERE / "executed_run.py"), str(scenario), str(folder)]


@pytest.fixture
def stop(scenario: Scenario, time_scale: float, pictures: Path, tmp_path: Path) -> Stop:
    """Does something to a run while the arm moves, and returns it once it has ended.

    `stop(act, figures=)` calls `act(run)`; `figures` is whether the figures that the run leaves
    tell how well it kept up.
    """

    def stop(act: Callable[[Run], None], *, figures: bool = True) -> Run:
        def attempt(time_scale: float) -> tuple[Run, Pace]:
            chosen = hardware_scenario(scenario, time_scale=time_scale)
            with stand_in(chosen, pictures, tmp_path) as robot:
                run = Run(robot, chosen, tmp_path)
                try:
                    run.wait_until_it_moves()
                    run.acted_at = run.clock()
                    act(run)
                    run.finish()
                finally:
                    if run.process.poll() is None:
                        run.process.kill()
                        run.process.communicate()
            return run, run.seen.pace(run.figures["figures"] if figures else {}, chosen)

        return first_kept(repeated(time_scale), attempt)[1]

    return stop


def is_whole(log: Path) -> bool:
    with log.open("rb") as stream:
        return make_reader(stream).get_summary() is not None


def was_told_to_rest(run: Run) -> bool:
    """Returns whether the arm was told to rest for longer than the driver follows a command."""
    told = [time for time, speed in run.seen.told if speed == 0.0]
    return max(told, default=0.0) - run.acted_at > run.scenario.poil.hardware.command_expiry


@pytest.mark.parametrize(
    ("number", "status", "reason"),
    [
        (signal.SIGINT, 130, "stopped by the user"),
        (signal.SIGTERM, 143, "terminated"),
        (signal.SIGHUP, 129, "the terminal has gone"),
    ],
)
def test_a_signal_brings_the_arm_to_rest(stop: Stop, number: int, status: int, reason: str) -> None:
    run = stop(lambda run: run.send(number))

    assert run.status == status, run.said
    assert [speed for time, speed in run.seen.speeds if time < run.acted_at][-1] > FAST
    assert run.seen.rest_after(run.acted_at) <= REST
    assert was_told_to_rest(run)
    assert run.figures["reason"] == reason
    assert is_whole(run.log)


def test_an_impatient_user_does_not_keep_the_arm_from_resting(stop: Stop) -> None:
    def interrupt_repeatedly(run: Run) -> None:
        for _ in range(6):
            run.send(signal.SIGINT)
            run.sleep(0.02)

    run = stop(interrupt_repeatedly, figures=False)

    assert run.status != 0
    assert run.seen.rest_after(run.acted_at) <= REST
    assert was_told_to_rest(run)


def test_a_run_that_is_halted_and_goes_on_does_not_move_the_arm_again(stop: Stop) -> None:
    def halt(run: Run) -> None:
        run.send(signal.SIGSTOP)
        run.sleep(1.0)
        run.send(signal.SIGCONT)

    run = stop(halt, figures=False)

    assert run.status == 1
    # The driver's expiry of 0.1 s, and the low pass.
    assert run.seen._replace(told=[]).rest_after(run.acted_at) <= 0.1 + REST
    assert run.figures["reason"].startswith(SAFETY_FAULT_TEXT[SafetyFault.LOOP_STALLED])
    assert is_whole(run.log)


def times_of(log: Path) -> list[float]:
    """Returns when [s] the messages of a log were logged, as far as it can be read."""
    times: list[float] = []
    with log.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                times += [record.log_time * 1e-9] if hasattr(record, "log_time") else []
        except (McapError, EOFError):
            pass
    return times


def test_a_run_that_is_killed_leaves_a_log_that_can_be_read(stop: Stop) -> None:
    run = stop(lambda run: run.send(signal.SIGKILL), figures=False)

    assert run.status == -signal.SIGKILL
    assert run.seen._replace(told=[]).rest_after(run.acted_at) <= 0.1 + REST
    commanded = run.seen.commanded
    # The log begins with the loop, and lacks what filled no chunk of 64 kB.
    assert max(times_of(run.log)) > commanded[-1] - commanded[0] - 0.5


def test_a_second_run_refuses_to_command_beside_the_first(stop: Stop, tmp_path: Path) -> None:
    folder = tmp_path / "second"
    folder.mkdir()
    ended = []

    def run_another(run: Run) -> None:
        second = command(tmp_path / "scenario.yaml", folder)
        ended.append(
            subprocess.run(second, env=ENVIRONMENT, capture_output=True, text=True, check=False)
        )
        run.send(signal.SIGINT)

    stop(run_another, figures=False)

    assert ended[-1].returncode != 0
    assert "Somebody else commands the robot" in ended[-1].stderr
    reason = json.loads((folder / "run.json").read_text())["reason"]
    assert "somebody else commands" in reason.lower()

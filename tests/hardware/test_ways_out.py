"""However a run ends while the arm moves: the arm rests, and the outputs are there."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hardware_bench import StandIn, hardware_scenario, stand_in
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from poil_drake.diagrams.dump_scenario import DumpScenario
from poil_drake.diagrams.scenario import Scenario
from poil_drake.systems.safety_faults import SAFETY_FAULT_TEXT, SafetyFault

pytestmark = pytest.mark.render

HERE = Path(__file__).parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(HERE.parent)}
REST = 0.15
FAST = 0.2  # [rad/s]: the swing is well on its way.


class Run:
    """A run in a process of its own, against a stand-in robot in another one."""

    def __init__(self, robot: StandIn, scenario: Path, folder: Path):
        self.robot, self.folder = robot, folder
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "executed_run.py"), str(scenario), str(folder)],
            env=ENVIRONMENT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def wait_until_it_moves(self) -> None:
        """Waits for the stand-in's word, and then until its arm is fast."""
        said = self.robot.process.stdout
        assert said is not None
        while not select.select([said], [], [], 0.1)[0]:
            # It may have ended for a reason of its own.
            assert self.process.poll() is None, self.process.communicate()
        assert said.readline() == "moving\n"
        time.sleep(0.5)

    def send(self, number: int) -> float:
        """Sends a signal and returns when [s since the epoch]."""
        now = time.time()
        self.process.send_signal(number)
        return now

    def finish(self) -> int:
        """Waits for the end, and returns the status."""
        self.said = self.process.communicate(timeout=60)
        return self.process.returncode

    @property
    def figures(self) -> dict:
        return json.loads((self.folder / "run.json").read_text())

    @property
    def log(self) -> Path:
        return self.folder / "run.mcap"

    def speeds(self) -> np.ndarray:
        """Returns rows of time and the arm's largest joint speed."""
        return np.array(self.robot.finish()["speeds"])


@pytest.fixture
def run(scenario: Scenario, pictures: Path, tmp_path: Path) -> Iterator[Run]:
    scenario = hardware_scenario(scenario)
    text = tmp_path / "scenario.yaml"
    text.write_text(DumpScenario(scenario))
    with stand_in(scenario, pictures, tmp_path) as robot:
        run = Run(robot, text, tmp_path)
        try:
            yield run
        finally:
            if run.process.poll() is None:
                run.process.kill()
            run.process.communicate()


def is_whole(log: Path) -> bool:
    with log.open("rb") as stream:
        return make_reader(stream).get_summary() is not None


@pytest.mark.parametrize(
    ("number", "status", "reason"),
    [
        (signal.SIGINT, 130, "stopped by the user"),
        (signal.SIGTERM, 143, "terminated"),
        (signal.SIGHUP, 129, "the terminal has gone"),
    ],
)
def test_a_signal_brings_the_arm_to_rest(run: Run, number: int, status: int, reason: str) -> None:
    run.wait_until_it_moves()
    stopped_at = run.send(number)

    assert run.finish() == status, run.said
    speeds = run.speeds()
    assert speeds[speeds[:, 0] < stopped_at, 1][-1] > FAST
    assert rest_after(speeds, stopped_at) <= REST
    assert run.figures["reason"] == reason
    assert is_whole(run.log)


def rest_after(speeds: np.ndarray, start: float) -> float:
    """Returns for how long after a time the arm was faster than 0.01 rad/s [s]."""
    moving = speeds[(speeds[:, 0] > start) & (speeds[:, 1] > 0.01), 0]
    return float(moving[-1] - start) if moving.size else 0.0


def test_an_impatient_user_does_not_keep_the_arm_from_resting(run: Run) -> None:
    run.wait_until_it_moves()
    stopped_at = run.send(signal.SIGINT)
    for _ in range(5):
        time.sleep(0.02)
        run.send(signal.SIGINT)

    assert run.finish() != 0
    assert rest_after(run.speeds(), stopped_at) <= REST


def test_a_run_that_is_halted_and_goes_on_does_not_move_the_arm_again(run: Run) -> None:
    run.wait_until_it_moves()
    halted_at = run.send(signal.SIGSTOP)
    time.sleep(1.0)
    run.send(signal.SIGCONT)

    assert run.finish() == 1
    # The driver's expiry of 0.1 s, and the low pass.
    assert rest_after(run.speeds(), halted_at) <= 0.1 + REST
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


def test_a_run_that_is_killed_leaves_a_log_that_can_be_read(run: Run) -> None:
    run.wait_until_it_moves()
    killed_at = run.send(signal.SIGKILL)

    assert run.finish() == -signal.SIGKILL
    time.sleep(0.5)
    seen = run.robot.finish()
    assert rest_after(np.array(seen["speeds"]), killed_at) <= 0.1 + REST
    commanded = seen["commanded"]
    # The log begins with the loop, and lacks what filled no chunk of 64 kB.
    assert max(times_of(run.log)) > commanded[-1] - commanded[0] - 0.5


def test_a_second_run_refuses_to_command_beside_the_first(run: Run, tmp_path: Path) -> None:
    run.wait_until_it_moves()
    folder = tmp_path / "second"
    folder.mkdir()

    second = subprocess.run(
        [
            sys.executable,
            str(HERE / "executed_run.py"),
            str(tmp_path / "scenario.yaml"),
            str(folder),
        ],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    run.send(signal.SIGINT)
    run.finish()

    assert second.returncode != 0
    assert "Somebody else commands the robot" in second.stderr
    assert (
        "somebody else commands" in json.loads((folder / "run.json").read_text())["reason"].lower()
    )

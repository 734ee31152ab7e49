import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from poil_drake.runtime.script_process import ScriptProcess, ScriptProcessError

SCRIPT = str(Path(__file__).with_name("echoing_script.py"))
PATIENT = 60.0  # [s]
IMPATIENT = 0.2  # [s]


@pytest.fixture
def start() -> Iterator[Callable[..., ScriptProcess]]:
    started = []

    def start(mode: str = "") -> ScriptProcess:
        started.append(ScriptProcess(sys.executable, SCRIPT, {"mode": mode}))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.end()


@pytest.fixture
def dut(start: Callable[..., ScriptProcess]) -> ScriptProcess:
    process = start()
    process.ask({}, timeout=PATIENT)
    return process


def mode(word: str) -> dict[str, np.ndarray]:
    return {"mode": np.frombuffer(word.encode(), np.uint8)}


def test_arrays_come_back_unchanged_from_another_process(dut: ScriptProcess) -> None:
    rng = np.random.default_rng(0)
    arrays = {
        "floats": rng.normal(size=(3, 4)),
        "bytes": rng.integers(0, 255, (5, 7, 3)).astype(np.uint8),
        "empty": np.empty((0, 3), np.float32),
        "strided": rng.normal(size=(6, 4))[::2, 1:],
        "flags": np.array([True, False]),
        "scalar": np.array(3.5, np.float32),
    }

    answer = dut.ask({**arrays, **mode("echo")}, timeout=PATIENT)

    assert answer["pid"] == dut.pid != os.getpid()
    for name, array in arrays.items():
        np.testing.assert_array_equal(answer[name], array, strict=True)


def test_more_than_a_pipe_holds_goes_both_ways(dut: ScriptProcess) -> None:
    large = np.arange(3_000_000)

    answer = dut.ask({"large": large, **mode("echo")}, timeout=PATIENT)

    np.testing.assert_array_equal(answer["large"], large)


def test_an_error_is_the_answer_and_the_process_continues(dut: ScriptProcess) -> None:
    with pytest.raises(ScriptProcessError, match="has failed: ZeroDivisionError: by mistake"):
        dut.ask(mode("fail"), timeout=PATIENT)

    assert dut.ask(mode("echo"), timeout=PATIENT)["pid"] == dut.pid


def test_an_error_of_the_setup_is_the_answer_to_every_request(
    start: Callable[..., ScriptProcess],
) -> None:
    dut = start("broken")

    for request in ({}, mode("echo")):
        with pytest.raises(ScriptProcessError, match="KeyError: 'in the beginning'"):
            dut.ask(request, timeout=PATIENT)


def test_a_dying_process_is_reported_with_its_status(dut: ScriptProcess) -> None:
    for _ in range(2):
        with pytest.raises(ScriptProcessError, match="has ended with status 7"):
            dut.ask(mode("die"), timeout=PATIENT)

    assert not dut.alive


def test_a_killed_process_is_reported(dut: ScriptProcess) -> None:
    os.kill(dut.pid, signal.SIGKILL)

    with pytest.raises(ScriptProcessError, match="has ended with status -9"):
        dut.ask(mode("echo"), timeout=PATIENT)


@pytest.mark.parametrize("word", ["hang", "hang with a child"])
def test_a_process_that_does_not_answer_is_killed(dut: ScriptProcess, word: str) -> None:
    with pytest.raises(ScriptProcessError, match=r"has not answered within 0\.2 s"):
        dut.ask(mode(word), timeout=IMPATIENT)

    assert not dut.alive


def test_a_frozen_process_that_reads_nothing_is_killed(dut: ScriptProcess) -> None:
    os.kill(dut.pid, signal.SIGSTOP)
    more_than_a_pipe_holds = {"large": np.zeros(3_000_000), **mode("echo")}

    with pytest.raises(ScriptProcessError, match="has not answered within"):
        dut.ask(more_than_a_pipe_holds, timeout=IMPATIENT)

    assert not dut.alive


def test_an_interpreter_that_does_not_exist_is_reported() -> None:
    with pytest.raises(ScriptProcessError, match=r"cannot be started: .*nowhere/python"):
        ScriptProcess("nowhere/python", SCRIPT, {})


def test_it_ends_with_its_maker_and_needs_no_guard(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\n"
        "from poil_drake.runtime.script_process import ScriptProcess\n"
        f"process = ScriptProcess(sys.executable, {SCRIPT!r}, {{'mode': ''}})\n"
        "process.ask({}, timeout=60)\n"
    )

    # The process inherits the output, which therefore ends only when it has ended, too.
    run = subprocess.run([sys.executable, str(script)], capture_output=True, text=True)

    assert (run.returncode, run.stderr) == (0, "this line does not disturb the answers\n")

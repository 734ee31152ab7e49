"""Functions that run in a worker process."""

import math
import os
import signal

import pytest

from poil_drake.errors import InvalidValueError, PoilError
from poil_drake.runtime.worker_executor import WorkerExecutor
from poil_drake.transfer.pipeline import TransferConfig


def test_functions_run_in_order_in_one_other_process() -> None:
    calls = ((os.getpid,), (math.sqrt, 4.0), (os.getpid,))
    with WorkerExecutor("json") as dut:
        first, root, again = (dut.submit(*call) for call in calls)

    assert root.result() == 2.0
    assert first.result() == again.result() != os.getpid()
    with pytest.raises(ProcessLookupError):
        os.kill(first.result(), 0)


def test_errors_reach_the_caller() -> None:
    with WorkerExecutor() as dut:
        bad_value, other = dut.submit(TransferConfig, num_points=2), dut.submit(math.sqrt, -1.0)

    with pytest.raises(InvalidValueError, match="num_points is 2"):
        bad_value.result()
    with pytest.raises(RuntimeError, match="math domain error"):
        other.result()


def test_a_process_that_has_died_is_an_error_with_a_remedy() -> None:
    with WorkerExecutor() as dut:
        os.kill(dut.submit(os.getpid).result(), signal.SIGKILL)
        pending = dut.submit(os.getpid)

    with pytest.raises(PoilError, match=r"A worker process has ended with status -9\. Check its"):
        pending.result()
    dut.shutdown()  # Once more.

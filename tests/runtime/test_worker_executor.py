"""Functions that run in a worker process."""

import math
import os
import signal
from collections.abc import Sequence

import pytest

from poil_drake.errors import InvalidValueError, PoilError
from poil_drake.runtime.worker_executor import WorkerExecutor, run_in_halves
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


def test_half_of_the_items_go_to_the_executor() -> None:
    with WorkerExecutor() as worker:
        shared = run_in_halves(_owned, range(5), worker)
        alone = run_in_halves(_owned, range(5), None)

    assert [item for item, _ in shared] == [item for item, _ in alone] == [0, 1, 2, 3, 4]
    here = os.getpid()
    assert [process == here for _, process in shared] == [True, True, True, False, False]
    assert {process for _, process in alone} == {here}


def _owned(items: Sequence[int]) -> list[tuple[int, int]]:
    return [(item, os.getpid()) for item in items]


@pytest.mark.parametrize("wrong", [0, 1], ids=["first half", "second half"])
def test_an_error_in_either_half_is_raised(wrong: int) -> None:
    sizes = [[3], [4]]
    sizes[wrong] = [2]

    with WorkerExecutor() as worker, pytest.raises(InvalidValueError, match="num_points is 2"):
        run_in_halves(_configured, [*sizes[0], *sizes[1]], worker)


def _configured(sizes: Sequence[int]) -> list[TransferConfig]:
    return [TransferConfig(num_points=size) for size in sizes]

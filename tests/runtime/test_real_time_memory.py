import ctypes
import subprocess
import sys

import pytest

from poil_drake.runtime import real_time_memory
from poil_drake.runtime.real_time_memory import KeepMemory

_PROGRAM = """
import resource, sys
from poil_drake.runtime.real_time_memory import KeepMemory

kept = sys.argv[1] == "kept" and KeepMemory()
faults = []
for _ in range(3):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(5):
        b"1" * 40_000_000
    faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
print(min(faults))
"""


def page_faults(how: str) -> int:
    """Returns how many pages 5 texts of 40 MB, one after the other, cost."""
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, how], capture_output=True, text=True, check=True
    )
    return int(done.stdout)


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="not the GNU C library")
def test_memory_is_used_again_without_asking_the_kernel() -> None:
    assert page_faults("kept") < 0.01 * page_faults("as ever")


def test_a_c_library_that_cannot_keep_memory_is_left_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(real_time_memory.ctypes, "CDLL", lambda name: object())

    assert not KeepMemory()

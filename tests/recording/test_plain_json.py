import json
from pathlib import Path

import numpy as np
import pytest

from poil_drake.recording.plain_json import plain_json


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.float32(0.5), 0.5),
        (np.int64(3), 3),
        (np.bool_(True), True),
        (float("nan"), None),
        (np.float64("-inf"), None),
        ((1.0, float("inf")), [1.0, None]),
        (np.array([[1.0, np.nan]]), [[1.0, None]]),
        ({1: {"a": (2,)}}, {"1": {"a": [2]}}),
        (Path("a/b"), "a/b"),
        (None, None),
        ("text", "text"),
    ],
)
def test_everything_becomes_what_json_has(value: object, expected: object) -> None:
    dut = plain_json(value)

    # 3 == 3.0 == True in Python, but not in JSON.
    assert json.dumps(dut, allow_nan=False) == json.dumps(expected)

import json
from pathlib import Path

import numpy as np
import pytest

from poil_drake.recording.mcap.plain_json import plain_json, write_json


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
def test_any_value_becomes_json(value: object, expected: object) -> None:
    dut = plain_json(value)

    # 3 == 3.0 == True in Python, but not in JSON.
    assert json.dumps(dut, allow_nan=False) == json.dumps(expected)


def test_figures_are_written_as_lines_or_as_one(tmp_path: Path) -> None:
    figures = {"errors": np.array([0.5, np.nan]), "name": "mug"}

    write_json(figures, tmp_path / "lines.json")
    write_json(figures, tmp_path / "line.json", indent=None)

    lines, line = ((tmp_path / name).read_text() for name in ("lines.json", "line.json"))
    assert json.loads(lines) == json.loads(line) == {"errors": [0.5, None], "name": "mug"}
    assert lines.startswith('{\n  "errors"')
    assert line.count("\n") == 1

"""The subjects of the benchmark and its figures; durations are not tested."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poil_drake.benchmarks.latency import latency
from poil_drake.benchmarks.latency.control_path import ControlPath


def test_all_subjects_are_timed_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new" / "latency.json"

    rows = latency.run_latency_benchmark(ticks=3, json_path=path)

    read = json.loads(path.read_text())
    assert read["ticks"] == 3
    assert [row["name"] for row in read["rows"]] == [row.name for row in rows]
    names = {row.name for row in rows}
    fields = {
        f"field, {test} test, {where}, {outliers}"
        for test in ("rigidity", "velocity")
        for where in ("near", "far")
        for outliers in ("clean", "2 outliers")
    }
    fields |= {f"field, 1000 states at once, {where}, each" for where in ("near", "far")}
    assert fields | {latency.BASELINE, latency.PATH, "SE(3) BCSDM, NumPy"} == names
    for row in rows:
        assert 0.0 < row.p50 <= row.p99 <= row.p99_9 <= row.largest < math.inf
        assert 0.0 < row.ratio < math.inf
    table = capsys.readouterr().out
    assert all(row.name in table for row in rows)


def test_figures_are_percentiles_in_microseconds_and_ratios_to_the_baseline() -> None:
    # 0 to 1000 us: the percentiles are their own names. The baseline takes 2000 us, always.
    field = np.arange(1001) * 1e-6

    dut, baseline = latency.summarize(["field", latency.BASELINE], [field, np.full(10, 2e-3)])

    figures = (dut.p50, dut.p99, dut.p99_9, dut.largest)
    assert figures == pytest.approx((500.0, 990.0, 999.0, 1000.0))
    assert dut.ratio == pytest.approx(0.25)
    assert baseline.ratio == pytest.approx(1.0)


@pytest.mark.parametrize("where", ["near", "far"])
def test_states_are_off_by_the_stated_distance_and_angle(where: str) -> None:
    X_WO, reference, points = latency.moving_body()
    distance, smallest, largest = latency.OFFSETS[where]

    states = latency.make_states(X_WO, points, where)

    assert reference.positions.shape == (500, 10, 3)
    for X in states.poses[:10]:
        distances = np.linalg.norm(X_WO[:, :3, 3] - X[:3, 3], axis=1)
        turns = Rotation.from_matrix(X[:3, :3] @ X_WO[:, :3, :3].swapaxes(1, 2)).magnitude()
        # One of the samples is the one that it was moved off.
        offset = np.abs(distances - distance) < 1e-9
        turned = (np.degrees(turns) > smallest - 1e-6) & (np.degrees(turns) < largest + 1e-6)
        assert (offset & turned).any()


def test_two_points_of_a_spoilt_state_are_outliers() -> None:
    X_WO, _, points = latency.moving_body()
    states = latency.make_states(X_WO, points, "near")

    off = np.linalg.norm(states.spoilt - states.clean, axis=2)

    assert (np.count_nonzero(off, axis=1) == 2).all()
    assert off[off > 0.0].min() >= 0.05 - 1e-12
    assert off.max() <= 0.1 + 1e-12


def test_control_path_carries_the_points_along_the_reference() -> None:
    dut = ControlPath(num_points=10, num_samples=500)

    speeds = []
    for _ in range(2000):
        dut.prepare()
        speeds.append(np.linalg.norm(dut.step()))

    # It moves, and after the 4 s of the reference and 3 / eta to catch up it has arrived. Then it
    # follows the tracker's noise: 3 mm/s and, over 5 cm, 0.06 rad/s at a single point.
    assert max(speeds[100:800]) > 0.1
    assert max(speeds[-100:]) < 0.08

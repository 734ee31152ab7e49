import dataclasses

import numpy as np
import pytest

from poil_drake.benchmarks.control import table as dut
from poil_drake.benchmarks.control.pictures import draw_pictures, success_by_distance
from poil_drake.benchmarks.control.trial import ControlTrial

TRIAL = ControlTrial(
    task="pnp_cube",
    region="far",
    policy="field",
    trial=0,
    success=True,
    collision_free=True,
    error=0.001,
    time=6.0,
    distance=0.1,
    path=np.array([[0.4, -0.2, 0.03], [0.5, 0.1, 0.2], [0.55, 0.2, 0.03]]),
)


def trials(successes, failures, **changes):
    good = [dataclasses.replace(TRIAL, trial=k, **changes) for k in range(successes)]
    bad = [dataclasses.replace(TRIAL, trial=k, success=False, **changes) for k in range(failures)]
    return [*good, *bad]


@pytest.mark.parametrize("successes", [90, 100])
def test_wilson_interval_is_that_of_the_formula(successes):
    n, p, z = 100, successes / 100, 1.95996

    interval = dut.wilson_interval(successes, n)

    middle = p + z**2 / (2 * n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    expected = np.array([middle - half, middle + half]) / (1 + z**2 / n)
    assert interval == pytest.approx(expected, abs=1e-5)


def test_collisions_count_in_the_second_column_only():
    bumped = [dataclasses.replace(one, collision_free=False) for one in trials(2, 1)]

    (cell,) = dut.summarize([*trials(5, 2), *bumped])

    assert (cell.trials, cell.successes, cell.clean) == (10, 7, 5)


def test_lost_trials_count_without_figures():
    lost = dataclasses.replace(TRIAL, success=False, error=np.nan, time=np.nan)

    (cell,) = dut.summarize([TRIAL, lost])

    assert (cell.trials, cell.successes) == (2, 1)
    assert cell.error == 0.001


def test_table_shows_measured_and_published_figures():
    cells = {(c.task, c.region, c.policy): c for c in dut.summarize(trials(9, 1, policy="pp_50"))}

    lines = dut.table_lines(cells, ["pnp_cube"], ("near", "far"), clean=False)

    (row,) = [line for line in lines if "50 demo" in line]
    assert "90 [60-98] (100)" in row
    assert "- (100)" in row
    assert any("Instant Policy, as published" in line for line in lines)
    without_collisions = dut.table_lines(cells, ["pnp_cube"], ("near", "far"), clean=True)
    assert not any("(" in line.replace("SE(3)", "") for line in without_collisions)


def test_success_is_binned_by_distance():
    near = trials(3, 0, region="near", distance=0.0)
    close, away = trials(1, 1, distance=0.05), trials(0, 2, distance=0.17)

    bins = success_by_distance([*near, *close, *away])

    assert [rate for _, rate, _ in bins] == [1.0, 0.5, 0.0]
    assert [middle for middle, _, _ in bins] == pytest.approx([-0.04, 0.04, 0.20])


def test_pictures_show_the_trials(tmp_path):
    import cv2

    near = trials(2, 0, region="near", distance=0.0)
    pictures = []
    for shown in ([*trials(3, 1), *near], [*trials(0, 4), *near]):
        draw_pictures(shown, tmp_path)
        paths = [tmp_path / f"control_{name}.png" for name in ("distance", "paths")]
        pictures.append([cv2.imread(str(path)) for path in paths])

    for one, other in zip(*pictures, strict=True):
        assert np.count_nonzero((one != other).any(axis=2)) > 50


def test_trials_that_an_error_ended_are_named_below_the_tables(capsys):
    lost = dataclasses.replace(
        TRIAL, success=False, collision_free=False, note="KeyError: 'x'", lost=True
    )

    dut.print_tables([TRIAL, lost])

    assert "ended in an error and count as failures: 1." in capsys.readouterr().out

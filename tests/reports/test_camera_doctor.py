import re

import numpy as np
import pytest

from poil_drake.perception.calibration.depth_check import Cause, DepthCheck, PairFit, TableFit
from poil_drake.reports.camera_doctor import camera_findings

GOOD = TableFit(offset=0.0006, deviation=0.001, tilt=0.001, rms=0.0008)
OFF = TableFit(offset=-0.0112, deviation=0.0141, tilt=np.deg2rad(0.55), rms=0.001)
FIT = PairFit(distance=0.001, disagreement=0.002, shift=np.zeros(3), turn=0.0)
MISFIT = PairFit(
    distance=0.007, disagreement=0.012, shift=np.array([-0.0121, 0.0, 0.0]), turn=np.deg2rad(0.3)
)


def check(causes: tuple[Cause, ...] = (), **changes: object) -> DepthCheck:
    values = {
        "tables": {"left": OFF if causes else GOOD, "right": GOOD},
        "pairs": {("left", "right"): FIT},
        "causes": {"left": causes} if causes else {},
        "table_height": None,
    }
    return DepthCheck(**{**values, **changes})


def test_good_cameras_are_shown_with_their_figures() -> None:
    left, right, pair = camera_findings(check())

    assert left.ok
    assert right.ok
    assert pair.ok
    assert left.found.startswith("table +0.6 mm (up to 1.0 off), tilted by 0.06 deg, noise 0.8 mm")
    assert pair.name == "left and right"


@pytest.mark.parametrize(
    ("causes", "remedy"),
    [
        ([("scale", 0.98)], "2.0 % too large. Multiply depth_scale .*cameras.left by 0.9800"),
        ([("scale", 10.01)], "10 times too small, so it is in another unit. Correct depth_scale"),
        ([("scale", 0.001)], "1000 times too large"),
        ([("scale", 3.9)], "4 times too small, so it is in another unit"),
        ([("bias", -0.0141)], "depth is 14.1 mm too large at all distances"),
        ([("pose", -0.0126)], "12.6 mm too high over the table.*Run poil calibrate cameras"),
        ([("pose", -1.2)], r"Its pose \(cameras.left.X_PB\) or poil.table_height is far off"),
        (
            [("scale", 1.02), ("pose", 0.012)],
            "2.0 % too small.* Or: Its pose is off: it is 12.0 mm too low.*put objects in view",
        ),
    ],
)
def test_the_remedy_says_by_what_a_camera_is_off(causes: list, remedy: str) -> None:
    dut = check(tuple(Cause(kind=kind, value=value) for kind, value in causes))

    left, right, _ = camera_findings(dut)

    assert (left.ok, right.ok) == (False, True)
    assert re.search(remedy, left.remedy)


def test_a_sideways_error_is_blamed_on_the_poses() -> None:
    *_, pair = camera_findings(check(pairs={("left", "right"): MISFIT}))

    assert not pair.ok
    assert "left's moves by [-12.1, 0.0, 0.0] mm and turns by 0.30 deg" in pair.found
    assert "a pose is off sideways. Run poil calibrate cameras." in pair.remedy


def test_clouds_that_are_too_far_apart_to_compare_are_a_fault() -> None:
    apart = PairFit(distance=np.inf, disagreement=np.inf, shift=np.full(3, np.nan), turn=np.nan)

    *_, pair = camera_findings(check(pairs={("left", "right"): apart}))

    assert not pair.ok
    assert pair.found == "see the objects above the table in different places"
    assert "a pose is off sideways" in pair.remedy


def test_a_third_camera_tells_which_pose_is_off() -> None:
    pairs = {("left", "right"): MISFIT, ("left", "top"): MISFIT, ("right", "top"): FIT}
    tables = {name: GOOD for name in ("left", "right", "top")}

    findings = {f.name: f for f in camera_findings(check(pairs=pairs, tables=tables))}

    assert "the pose of left" in findings["left and right"].remedy
    assert "the pose of left" in findings["left and top"].remedy
    assert findings["right and top"].ok


def test_a_wrong_table_comes_first() -> None:
    tables = {"left": OFF, "right": OFF}

    table, left, *_ = camera_findings(check(table_height=0.0123, tables=tables))

    assert "set poil.table_height to 0.0123" in table.remedy
    assert left.remedy == "See the finding on the table."


def test_missing_tables_and_objects_are_named() -> None:
    left, pair = camera_findings(check(tables={"left": None}, pairs={("left", "right"): None}))

    assert not left.ok
    assert "sees no level plane" in left.found
    assert pair.ok
    assert "put objects in view of both" in pair.found

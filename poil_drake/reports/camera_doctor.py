"""Says in words what is wrong with the cameras' depth."""

from collections.abc import Mapping, Sequence

import numpy as np

from poil_drake.perception.calibration.depth_check import (
    Cause,
    DepthCheck,
    PairFit,
    TableFit,
    wrong_unit,
)
from poil_drake.perception.calibration.view_cloud import BAND
from poil_drake.reports.finding import Finding

_CALIBRATE = "Run poil calibrate cameras."


def camera_findings(check: DepthCheck) -> list[Finding]:
    """Returns one finding for each camera and each pair of cameras."""
    findings = []
    if check.table_height is not None:
        findings.append(
            Finding(
                "table",
                False,
                f"all cameras see the table at {check.table_height:.4f} m, level, and agree",
                f"If the robot's base and the cameras are right, set poil.table_height to "
                f"{check.table_height:.4f}; otherwise calibrate the cameras to the robot.",
            )
        )
    for name, fit in check.tables.items():
        findings.append(_camera_finding(name, fit, check))
    for names, pair in check.pairs.items():
        findings.append(_pair_finding(names, pair, check))
    return findings


def _camera_finding(name: str, fit: TableFit | None, check: DepthCheck) -> Finding:
    if fit is None:
        return Finding(
            name,
            False,
            "sees no level plane that may be the table",
            "Check that it sees a free part of the table and measures its depth there, and that "
            f"cameras.{name}.X_PB and poil.table_height are about right.",
        )
    found = (
        f"table {1e3 * fit.offset:+.1f} mm (up to {1e3 * fit.deviation:.1f} off), tilted by "
        f"{np.rad2deg(fit.tilt):.2f} deg, noise {1e3 * fit.rms:.1f} mm (RMS)"
    )
    causes = [_cause_text(name, cause, fit) for cause in check.causes.get(name, ())]
    remedy = " Or: ".join(causes)
    if len(causes) > 1:
        alone = len(check.tables) == 1
        remedy += (
            " Or: poil.table_height is wrong."
            if alone
            else " To tell which, put objects in view of several cameras."
        )
    if check.table_height is not None:
        remedy = "See the finding on the table."
    return Finding(name, fit.ok, found, remedy)


def _cause_text(name: str, cause: Cause, fit: TableFit) -> str:
    """Returns what a cause means, and what to do."""
    source = f"poil.hardware.cameras.{name}"
    tool = "calibrate the camera's depth with its maker's tool"
    if cause.kind == "scale":
        if (ratio := wrong_unit(cause.value)) is not None:
            size = "small" if ratio > 1.0 else "large"
            return (
                f"Its depth is {max(ratio, 1.0 / ratio):g} times too {size}, so it is in another "
                "unit. "
                f"Correct depth_scale in {source}, or what sends the images."
            )
        error = 1.0 / cause.value - 1.0
        return (
            f"Its depth is {100 * abs(error):.1f} % too {'large' if error > 0 else 'small'}. "
            f"Multiply depth_scale in {source} by {cause.value:.4f} if it has one; otherwise "
            f"{tool}. Check the focal length, too."
        )
    if cause.kind == "bias":
        size = "large" if cause.value < 0.0 else "small"
        return (
            f"Its depth is {1e3 * abs(cause.value):.1f} mm too {size} at all distances: {tool}, "
            "and check that depth is in the colour camera's view."
        )
    if abs(cause.value) > BAND:
        return (
            f"Its pose (cameras.{name}.X_PB) or poil.table_height is far off. The camera looks "
            "along +z, with +y down in the image."
        )
    side = "low" if cause.value > 0.0 else "high"
    return (
        f"Its pose is off: it is {1e3 * abs(cause.value):.1f} mm too {side} over the table, and "
        f"turned by {np.rad2deg(fit.tilt):.2f} deg. {_CALIBRATE}"
    )


def _pair_finding(names: tuple[str, str], pair: PairFit | None, check: DepthCheck) -> Finding:
    name = " and ".join(names)
    if pair is None:
        found = "see too few common surfaces above the table: put objects in view of both"
        return Finding(name, True, found, "")
    x, y, z = 1e3 * pair.shift
    found = (
        f"clouds {1e3 * pair.distance:.1f} mm apart (median); they fit best if {names[0]}'s moves "
        f"by [{x:.1f}, {y:.1f}, {z:.1f}] mm and turns by {np.rad2deg(pair.turn):.2f} deg"
    )
    tables = [check.tables[camera] for camera in names]
    if np.isinf(pair.distance):
        found = "see the objects above the table in different places"
    blamed = [n for n, fit in zip(names, tables, strict=True) if fit is None or not fit.ok]
    if blamed:
        remedy = f"First mend {' and '.join(blamed)}, then check again."
    else:
        guilty = _outlier(check.pairs, names)
        whose = f"the pose of {guilty}, which no other camera confirms," if guilty else "a pose"
        remedy = f"The table does not show this, so {whose} is off sideways. {_CALIBRATE}"
    return Finding(name, pair.ok, found, remedy)


def _outlier(pairs: Mapping[tuple[str, str], PairFit | None], names: Sequence[str]) -> str | None:
    """Returns which of two cameras disagrees with a third one, if the other agrees with it."""

    def agrees(camera: str) -> list[bool]:
        return [
            pair.ok
            for key, pair in pairs.items()
            if pair is not None and camera in key and set(key) != set(names)
        ]

    first, second = (agrees(name) for name in names)
    if any(first) and not any(second):
        return names[1]
    if any(second) and not any(first):
        return names[0]
    return None

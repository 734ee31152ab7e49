"""Fixtures of the tests with a stand-in robot."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hardware_bench import execute, hardware_scenario, swinging_plan, track_with
from machine_pace import ROOM, Pace, first_that_keeps_up, slower_scales
from prior_tracker import PriorTracker

from poil_drake.diagrams.run import skill_run
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation

RunThatKeepsUp = Callable[[Callable[[float], tuple[Any, Pace]]], Any]


@pytest.fixture(autouse=True)
def no_pace_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the dry run of 2 s before each run; `test_measured_pace.py` tests it alone."""
    monkeypatch.setattr(skill_run, "pace_warning", lambda plan, scenario: None)


@pytest.fixture(scope="session")
def pictures(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An npz with the first images of the cameras of the package's scenario, with labels."""
    station = MakeStation(scenario, ignore_output_delay=True)
    frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)
    path = tmp_path_factory.mktemp("pictures") / "pictures.npz"
    arrays = {
        f"{camera.name}.{kind}": getattr(image, kind)
        for camera, image in zip(frame.cameras, frame.images, strict=True)
        for kind in ("rgb", "depth", "label")
    }
    np.savez(path, **arrays)
    return path


@pytest.fixture(scope="session")
def time_scale(
    request: pytest.FixtureRequest,
    scenario: Scenario,
    pictures: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> float:
    """Seconds of the robot's time per second that this machine keeps up with, from a trial run."""
    chosen = request.config.getoption("--time-scale")
    if chosen is not None:
        return chosen

    def attempt(time_scale: float) -> tuple[tuple[float, Pace], Pace]:
        trial = hardware_scenario(scenario, time_scale=time_scale)
        summary, record = execute(
            swinging_plan(), trial, pictures, tmp_path_factory.mktemp("trial"), fault="reflex"
        )
        pace = record.pace(summary.to_dict(), trial)
        return (time_scale, pace), pace

    with pytest.MonkeyPatch.context() as monkeypatch:
        track_with(PriorTracker(), monkeypatch)
        scale, pace = first_that_keeps_up(slower_scales(1.0, step=0.5**0.5), attempt, worst=ROOM)
    if scale < 1.0:
        warnings.warn(f"Real-time tests run at a time scale of {scale:.3g}: {pace}.", stacklevel=1)
    return scale


@pytest.fixture(scope="session")
def run_that_keeps_up(time_scale: float) -> RunThatKeepsUp:
    """Returns a function that repeats attempts until one keeps up, and returns its result.

    Later attempts begin at the time scale of the last one that kept up.
    """
    usual = time_scale

    def run_that_keeps_up(attempt: Callable[[float], tuple[Any, Pace]]) -> Any:
        def at_scale(scale: float) -> tuple[tuple[float, Any], Pace]:
            result, pace = attempt(scale)
            return (scale, result), pace

        nonlocal usual
        # Twice at the usual scale, because a machine may be busy for a moment.
        usual, result = first_that_keeps_up([usual, *slower_scales(usual)], at_scale)
        return result

    return run_that_keeps_up

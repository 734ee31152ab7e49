"""Trials of `poil run --hardware` against `poil driver`: two processes linked by LCM."""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from poil_drake.diagrams.run.skill_run import RecordScenarioDemonstration
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import StationError
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.reports.progress import OneLineTqdm

_START = 60.0
"""Time limit for the start of a driver [s]."""

_END = 15.0
"""Time limit for the end of a driver [s]."""


@dataclass(frozen=True, kw_only=True)
class HardwareTrial:
    """The result of a trial.

    Attributes:
        seed: Seed of object, pose and noise.
        success: Whether the run reported success, and the object hung in the driver's physics.
        reason: Why the run ended.
        hanging_time: Time for which the object had hung when the driver ended [s].
        run_time: Duration of the run's closed loop [s of the robot's time].
        run_figures: Timing figures of the run's loop, by name.
        driver_figures: Timing figures of the driver's loop, by name.
        largest_lag: Longest time by which the simulated driver lagged behind the clock [s].
    """

    seed: int
    success: bool
    reason: str
    hanging_time: float
    run_time: float
    run_figures: dict[str, float]
    driver_figures: dict[str, float]
    largest_lag: float


def run_hardware_benchmark(
    *, trials: int, speed: float, time_scale: float, json_path: Path
) -> list[HardwareTrial]:
    """Runs `poil run --hardware` against `poil driver` for one seed after another.

    Args:
        trials: Number of trials, with seeds 0 to trials - 1.
        speed: Speed of the motion, as a share of the simulated speed.
        time_scale: Seconds of the robot's time per second, in both processes.
        json_path: JSON file for the results.

    Raises:
        StationError: if a driver does not start.
    """
    results: list[HardwareTrial] = []
    options = {"speed": speed, "time_scale": time_scale}
    with tempfile.TemporaryDirectory() as folder, OneLineTqdm(total=trials, desc="trials") as bar:
        demonstration = Path(folder) / "demo.mcap"
        RecordScenarioDemonstration(ChooseScenario(), demonstration)
        for seed in range(trials):
            trial_folder = Path(folder) / f"seed_{seed}"
            trial_folder.mkdir()
            trial = _run_trial(seed, demonstration, folder=trial_folder, **options)
            results.append(trial)
            tqdm.write(_row(trial))
            bar.update()
            figures = {"summary": summarize(results), "trials": [asdict(one) for one in results]}
            write_json(options | figures, json_path)
    for name, value in summarize(results).items():
        print(f"{name.replace('_', ' '):36s} {value:.3f}")
    return results


def _run_trial(
    seed: int, demonstration: Path, *, speed: float, time_scale: float, folder: Path
) -> HardwareTrial:
    """Runs one trial, with the files of both processes in a folder."""
    shared = ["--seed", str(seed), "--time-scale", str(time_scale)]
    text = json.dumps({"poil": {"demonstration": str(demonstration)}})
    with simulated_driver([*shared, "--json", "driver.json"], folder):
        subprocess.run(
            [
                *_poil("run", "--hardware", "--no-meshcat", "--speed", str(speed), *shared),
                *("--scenario_text", text, "--json", "run.json", "--mcap", "run.mcap"),
            ],
            cwd=folder,
            stdout=(folder / "run.log").open("wb"),
            stderr=subprocess.STDOUT,
            check=False,
        )
    run, driver = _read(folder / "run.json"), _read(folder / "driver.json")
    return HardwareTrial(
        seed=seed,
        success=bool(run.get("success") and driver.get("hangs")),
        reason=run.get("reason") or _last_line(folder / "run.log"),
        hanging_time=driver.get("hanging_time", 0.0),
        run_time=run.get("timing", {}).get("simulated", 0.0),
        run_figures=run.get("figures", {}),
        driver_figures=driver.get("figures", {}),
        largest_lag=driver.get("largest_lag", float("nan")),
    )


def _read(path: Path) -> dict[str, Any]:
    """Returns the JSON object in a file; an empty one if the process did not write the file."""
    return json.loads(path.read_text()) if path.exists() else {}


def _last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").strip().splitlines()
    return lines[-1] if lines else "no output"


@contextmanager
def simulated_driver(arguments: Sequence[str], folder: Path) -> Iterator[None]:
    """Runs `poil driver` during a `with` block.

    Args:
        arguments: Options of `poil driver`.
        folder: Working directory of the process. Its output goes to "driver.log" there.

    Raises:
        StationError: if the driver does not start.
    """
    log = folder / "driver.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            _poil("driver", *arguments), cwd=folder, stdout=output, stderr=subprocess.STDOUT
        )
    try:
        deadline = time.monotonic() + _START
        while "listens" not in log.read_text(errors="replace"):
            if process.poll() is not None or time.monotonic() > deadline:
                raise StationError(
                    f"The simulated driver did not start: {_last_line(log)}.",
                    remedy="Run `poil driver` by hand to see why.",
                )
            time.sleep(0.1)
        yield
    finally:
        process.terminate()
        try:
            process.wait(_END)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def summarize(trials: Sequence[HardwareTrial]) -> dict[str, float]:
    """Returns statistics over all trials, by name."""
    runs = [trial.run_figures for trial in trials]
    drivers = [trial.driver_figures for trial in trials]
    return {
        "trials": float(len(trials)),
        "successes": float(sum(trial.success for trial in trials)),
        "missed_ticks_of_run": _share(runs, "missed_ticks"),
        "missed_ticks_of_driver": _share(drivers, "missed_ticks"),
        "largest_lag_of_driver_s": max(trial.largest_lag for trial in trials),
        "run_tick_period_p999_ms": float(
            np.median([one.get("tick_period_p999_ms", np.nan) for one in runs])
        ),
    }


def _share(figures: Sequence[dict[str, float]], name: str) -> float:
    """Returns a figure that counts ticks, such as "missed_ticks", as a share of all ticks."""
    ticks = sum(one.get("ticks", 0.0) for one in figures)
    return sum(one.get(name, 0.0) for one in figures) / ticks if ticks else float("nan")


def _poil(*arguments: Any) -> list[str]:
    return [sys.executable, "-P", "-m", "poil_drake", *arguments]


def _row(trial: HardwareTrial) -> str:
    return (
        f"seed {trial.seed:2d} {'hangs ' if trial.success else 'FAILED'} "
        f"{trial.run_time:5.1f} s, driver at most {1e3 * trial.largest_lag:.0f} ms behind: "
        f"{trial.reason}"
    )

"""The main job on the hardware path: run and simulated driver as two processes, over LCM."""

import json
import signal
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
from poil_drake.diagrams.scenario.choice import ChooseScenario
from poil_drake.errors import StationError
from poil_drake.recording.mcap.plain_json import plain_json, write_json
from poil_drake.reports.progress import OneLineTqdm

_START = 60.0
"""How long a driver may take to listen [s]."""

_END = 15.0
"""How long it may take to end [s]."""


@dataclass(frozen=True, kw_only=True)
class HardwareTrial:
    """How one trial went.

    Attributes:
        seed: Draws the trial.
        success: Whether the run said that it has done all, and the driver saw the object hang.
        reason: What the run said.
        hanging_time: For how long the object hung when the driver ended [s].
        run_time: The run's closed loop [s of the robot's time].
        run_figures: Of the run's loop.
        driver_figures: Of the driver's loop.
        largest_lag: How far the simulated driver fell behind at worst [s].
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
    """Runs `poil run --hardware` against `poil driver` with one seed after the other.

    Args:
        trials: Seeds 0 to trials - 1.
        speed: Share of the usual speed.
        time_scale: Seconds of the robot's time per second, in both processes.
        json_path: Where the figures go.

    Raises:
        StationError: if a driver does not start.
    """
    found: list[HardwareTrial] = []
    with tempfile.TemporaryDirectory() as folder, OneLineTqdm(total=trials, desc="trials") as bar:
        demonstration = Path(folder) / "demo.mcap"
        RecordScenarioDemonstration(ChooseScenario(), demonstration)
        for seed in range(trials):
            trial = run_trial(
                seed,
                demonstration,
                speed=speed,
                time_scale=time_scale,
                folder=Path(folder) / f"seed_{seed}",
            )
            found.append(trial)
            tqdm.write(_row(trial))
            bar.update()
            write_json(
                plain_json(
                    {
                        "speed": speed,
                        "time_scale": time_scale,
                        "summary": summarize(found),
                        "trials": [asdict(one) for one in found],
                    }
                ),
                json_path,
            )
    for name, value in summarize(found).items():
        print(f"{name.replace('_', ' '):36s} {value:.3f}")
    return found


def run_trial(
    seed: int, demonstration: Path, *, speed: float, time_scale: float, folder: Path
) -> HardwareTrial:
    """Runs both processes once.

    Args:
        seed: Draws object, pose and noise.
        demonstration: What to do.
        speed: Share of the usual speed.
        time_scale: Seconds of the robot's time per second.
        folder: For what they write.

    Raises:
        StationError: if the driver does not start.
    """
    folder.mkdir(parents=True, exist_ok=True)
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
    """Returns the figures in a file; none where a process has left none."""
    return json.loads(path.read_text()) if path.exists() else {}


def _last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").strip().splitlines()
    return lines[-1] if lines else "no word"


@contextmanager
def simulated_driver(arguments: Sequence[str], folder: Path) -> Iterator[None]:
    """Runs `poil driver` beside a block, and ends it after that.

    Args:
        arguments: Its options.
        folder: Where it runs, and writes "driver.log".

    Raises:
        StationError: if it does not start.
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
                    f"The simulated driver did not start: {_last_line(log)}",
                    remedy="Try poil driver by hand.",
                )
            time.sleep(0.1)
        yield
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(_END)
            except subprocess.TimeoutExpired:
                process.kill()
        process.wait()


def summarize(trials: Sequence[HardwareTrial]) -> dict[str, float]:
    """Returns the figures over all trials."""
    return {
        "trials": float(len(trials)),
        "successes": float(sum(trial.success for trial in trials)),
        "missed_ticks_of_run": _share(trials, "run_figures", "missed_ticks"),
        "missed_ticks_of_driver": _share(trials, "driver_figures", "missed_ticks"),
        "largest_lag_of_driver_s": max((trial.largest_lag for trial in trials), default=0.0),
        "run_tick_period_p999_ms": float(
            np.median([t.run_figures.get("tick_period_p999_ms", np.nan) for t in trials])
        ),
    }


def _share(trials: Sequence[HardwareTrial], of: str, name: str) -> float:
    """Returns the share of all ticks to which something happened."""
    figures: list[dict[str, float]] = [getattr(trial, of) for trial in trials]
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

"""Replays a recorded run: the same diagram, fed with the sensor messages of the run's log."""

import hashlib
import math
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from scipy.spatial.transform import Rotation

from poil_drake.diagrams.loop.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.replay.setup import RECORDED, ReplaySetup, SetUpReplay
from poil_drake.diagrams.run.open_run_log import OpenRunLog
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.station.replay_station import ReplayStation
from poil_drake.perception.images import CameraModel
from poil_drake.recording.comparison.run_comparison import compare_runs
from poil_drake.recording.comparison.tolerances import ReplayTolerances
from poil_drake.recording.run_log.layout import (
    DRY_RUN,
    REPLAY_OF_DIGEST_KEY,
    REPLAY_OF_KEY,
    REPLAY_TEXT_KEY,
    REPLAY_TRACKER_KEY,
    SIMULATED,
    STOPS_TOPIC,
)
from poil_drake.recording.run_log.reader import load_recorded_run
from poil_drake.recording.run_log.recorded_run import RecordedRun
from poil_drake.recording.run_log.writer import RunLogConfig
from poil_drake.reports.progress import ProgressBar
from poil_drake.reports.replay_picture import make_replay_picture
from poil_drake.reports.replay_summary import ReplaySummary
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.real_time import QuietInterpreter
from poil_drake.systems.skill.stop_requests import StopSwitch

_SAME_LENGTH = 1e-5
"""Positions closer than this [m] count as equal: far below any calibration error."""

_SAME_ANGLE = 1e-5
"""Rotations smaller than this [rad] are ignored: they move a point at ten metres by 0.1 mm."""

_SAME_PIXELS = 1e-3
"""Focal lengths and principal points closer than this [px] count as equal."""


def Replay(
    path: str | Path,
    *,
    tracker: str | None = None,
    scenario_text: str | None = None,
    outputs: OutputPaths | None = None,
    tolerances: ReplayTolerances | None = None,
    show_progress: bool = True,
) -> ReplaySummary:
    """Replays a run as fast as possible, and compares the new commands with the recorded ones.

    The robot's measurements come from the log and do not follow the new commands, so differences do
    not grow over time. Perception captures images and releases results at the times of the run.

    Args:
        path: The log of the run. The run may have been killed.
        tracker: An image-based tracker, or `RECORDED`, which repeats the run's tracks. None selects
            the run's tracker, or `RECORDED` if the run's tracker was the ground truth.
        scenario_text: YAML that changes values of the run's scenario, to try other settings.
        outputs: Paths of the replay's log, picture and figures; None writes nothing.
        tolerances: The largest differences that count as equal. None selects `CONTROL_TOLERANCES`
            if the replay repeats the tracks, else `PERCEPTION_TOLERANCES` at the run's speed.
        show_progress: Whether to draw a progress bar.

    Returns:
        The comparison of the replay with the run.

    Raises:
        RunLogError: if the log is missing, damaged or incomplete.
        OutputError: if an output path is not writable; older outputs are then kept.
        PoilError: if the loop cannot be built with these settings.
    """
    path, outputs = Path(path), outputs or OutputPaths()
    outputs.check(inputs=(path,))
    setup = SetUpReplay(path, tracker=tracker, scenario_text=scenario_text)
    repeat_tracks = setup.tracker == RECORDED
    station = ReplayStation(setup.scenario, setup.run, repeat_tracks=repeat_tracks)
    notes = setup.notes
    if not repeat_tracks and not setup.cameras_moved:
        notes += CameraNotes(setup.run, station.camera_models)
    outputs.unlink()
    with tempfile.TemporaryDirectory(prefix="poil_replay_") as folder:
        log = outputs.mcap or Path(folder) / "replay.mcap"
        with ProgressBar(disable=not show_progress) as progress:
            wall = _run(setup, station, log, images=outputs.mcap is not None, progress=progress)
        replayed = load_recorded_run(log)
    summary = ReplaySummary(
        log=str(path),
        station=setup.station,
        tracker=setup.tracker,
        changed=setup.changed,
        comparison=compare_runs(setup.run, replayed, tolerances or setup.tolerances),
        replayed=setup.run.end,
        wall=wall,
        notes=notes,
        outputs={kind: str(file) for kind, file in vars(outputs).items() if file is not None},
    )
    if outputs.png is not None:
        make_replay_picture(
            outputs.png,
            summary=summary,
            recorded=setup.run,
            replayed=replayed,
            velocity_limits=PandaModel().velocity,
        )
    if outputs.json is not None:
        summary.write_json(outputs.json)
    return summary


def _run(
    setup: ReplaySetup,
    station: ReplayStation,
    log: Path,
    *,
    images: bool,
    progress: ProgressBar,
) -> float:
    """Simulates the loop for the duration of the log, and returns the wall-clock time taken [s]."""
    with setup.run.path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    switch = StopSwitch()
    start = time.perf_counter()
    with (
        OpenRunLog(
            log,
            plan=setup.plan,
            scenario=setup.scenario,
            station=setup.station,
            metadata={
                REPLAY_OF_KEY: setup.run.path.name,
                REPLAY_OF_DIGEST_KEY: digest,
                REPLAY_TRACKER_KEY: setup.tracker,
                REPLAY_TEXT_KEY: setup.scenario_text,
            },
            config=RunLogConfig(images=images),
        ) as writer,
        MakeClosedLoop(
            setup.scenario,
            setup.plan,
            station=station,
            hardware=setup.station != SIMULATED,
            dry_run=setup.station == DRY_RUN,
            log=writer,
            stop_switch=switch,
        ) as loop,
    ):
        simulator = Simulator(loop.diagram)
        ApplySimulatorConfig(setup.scenario.simulator_config, simulator)
        simulator.set_target_realtime_rate(0.0)
        with QuietInterpreter(collecting=True):
            _advance(loop, simulator, setup.run, switch, progress)
    progress("replay", 1.0)
    return time.perf_counter() - start


def _advance(
    loop: ClosedLoop,
    simulator: Simulator,
    run: RecordedRun,
    switch: StopSwitch,
    progress: ProgressBar,
) -> None:
    rates = loop.station.scenario.poil.rates
    stops = _stops(run, rates.control)
    simulator.Initialize()
    now = 0.0
    while now < run.end:
        while stops and stops[0] <= now:
            stops.pop(0)
            switch.request()
        boundary = min(rates.next_report(now), run.end, *stops[:1])
        simulator.AdvanceTo(boundary)
        now = simulator.get_context().get_time()
        progress("replay", min(now / run.end, 0.99))


def _stops(run: RecordedRun, period: float) -> list[float]:
    """Returns, for each logged stop request, the time [s] of the control tick that noticed it."""
    series, asked = run.numbers[STOPS_TOPIC], 0.0
    ticks: list[float] = []
    for logged, requests in zip(series.times, series.values[:, 0], strict=True):
        if math.isfinite(requests) and requests > asked:
            tick = (math.ceil(logged / period - 1e-6) - 1) * period
            ticks += [max(tick, 0.0)] * int(min(requests - asked, 1000.0))
            asked = requests
    return ticks


def CameraNotes(run: RecordedRun, models: Sequence[CameraModel]) -> tuple[str, ...]:
    """Returns remarks on the cameras whose intrinsics or poses differ between run and replay.

    Each remark is a clause about one camera. Cameras missing from the log are skipped.

    Args:
        run: The recorded run.
        models: The cameras of the replay.
    """
    found = {model.name: " and ".join(_differences(run, model)) for model in models}
    return tuple(f"in the run, camera '{name}' {text}" for name, text in found.items() if text)


def _differences(run: RecordedRun, model: CameraModel) -> Iterator[str]:
    if (found := run.calibrations.get(model.name)) is not None:
        if (found.width, found.height) != (model.width, model.height):
            yield f"had {found.width} x {found.height} pixels"
        elif (largest := np.abs(found.K - model.K).max()) > _SAME_PIXELS:
            yield f"had intrinsics that differ by {largest:.2g} px from the replay's"
    if (X_WC := run.camera_poses.get(model.name)) is not None:
        distance = np.linalg.norm(X_WC[:3, 3] - model.X_WC[:3, 3])
        if distance > _SAME_LENGTH:
            yield f"was {1e3 * distance:.2g} mm from its position in the replay"
        angle = Rotation.from_matrix(X_WC[:3, :3].T @ model.X_WC[:3, :3]).magnitude()
        if angle > _SAME_ANGLE:
            yield f"was rotated by {np.rad2deg(angle):.2g} deg relative to the replay"

"""Records a demonstration that a person gives, with the scenario's real cameras and no robot."""

import math
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from pydrake.geometry import Meshcat

from poil_drake.diagrams.run.html_recording import MakeMeshcat
from poil_drake.diagrams.scenario.hardware_config import LcmImages
from poil_drake.diagrams.scenario.load import DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import MakeCameraModels
from poil_drake.diagrams.station.cameras.capture_sources import (
    CheckHardwareCameras,
    MakeCaptureDevice,
    SendsLabels,
)
from poil_drake.diagrams.station.station_models import MakeUnsimulatedPlant
from poil_drake.errors import DemonstrationError, ScenarioError, StationError
from poil_drake.perception.capture.capture_thread import CaptureThread, camera_problems
from poil_drake.perception.images import CameraModel
from poil_drake.recording.demonstration.demonstration import Demonstration, load_demonstration
from poil_drake.recording.demonstration.live_recorder import (
    LABEL_WAIT,
    CameraRecord,
    LiveRecorder,
)
from poil_drake.reports.contact_sheet import contact_sheet
from poil_drake.reports.progress import StatusLine
from poil_drake.runtime.held_signals import HeldSignals
from poil_drake.runtime.output_files import require_new, require_writable
from poil_drake.systems.skill.stop_requests import StopSwitch, terminal_stop_key
from poil_drake.systems.visualization.camera_preview import CameraPreview

BUTTON = "Start / stop"
"""The button on the Meshcat page."""

BUTTON_KEY = "Space"
"""The key that presses the button while the page has the focus."""

_KEYS = b" \r\n"  # Space and Enter.

_TICK = 0.02  # [s] between two looks at keys and errors.
_SHOW = 0.25  # [s] between two changes of the page and the status line.

_WAITING, _SAVED = "waiting for cameras", "saved"
_READY, _RECORDING = "ready: Space starts", "recording: Space stops"


def RecordFromCameras(
    scenario: Scenario,
    path: str | Path,
    *,
    show: bool = True,
    countdown: int = 3,
    duration: float = math.inf,
    lossless: bool = False,
) -> Demonstration:
    """Records what the scenario's real cameras deliver to a new file; no robot is needed.

    Waits until every camera delivers images. Space or Enter in the terminal, or the button on the
    page, then starts the recording after the countdown, and stops it. Without a terminal and a
    page, the recording starts by itself. Every image is written as it arrives, with its own stamp.
    The recording's contact sheet is drawn beside it (`path` as .png).

    However the recording ends, the file holds what the cameras have delivered. A signal or another
    exception during the recording is raised again when the file is complete. A file that could not
    be completed can still be loaded (see `DemonstrationWriter`).

    Args:
        scenario: Has the cameras, in `cameras` and `poil.hardware.cameras`.
        path: The MCAP file, which must not exist.
        show: Whether to serve a live page with the cameras' clouds and the button.
        countdown: Time from the key to the recording [s].
        duration: The recording stops by itself after this time [s, by the cameras' clock].
        lossless: Whether colour is not compressed as JPEG and depth is not rounded to millimetres.

    Returns:
        The recording.

    Raises:
        ScenarioError: if the scenario has no cameras, or they cannot be used.
        StationError: naming the cameras that deliver nothing within `poil.hardware.ready_timeout`.
        OutputError: if the file exists, or one of the two cannot be written.
        DemonstrationError: if the file could not be completed, nothing was recorded, or the
            recording is no demonstration, e.g. because a camera stopped before its end.
    """
    path = Path(path)
    require_new(path)
    require_writable(path)
    require_writable(path.with_suffix(".png"), inputs=(path,))
    if not scenario.cameras:
        raise ScenarioError(
            "The scenario has no cameras, so nothing can be recorded.",
            remedy="Define at least one under 'cameras'.",
        )
    CheckHardwareCameras(scenario)
    plant, _, label_ids = MakeUnsimulatedPlant(scenario)
    cameras = MakeCameraModels(plant, scenario.cameras)
    recorder = LiveRecorder(
        path,
        cameras,
        {
            "scenario": scenario.source.name,
            "scenario_file": scenario.source.file,
            "fixture": scenario.poil.fixture,
            "part": scenario.poil.part,
        },
        label_ids=label_ids,
        scenario_text=DumpScenario(scenario),
        lossless=lossless,
    )
    with ExitStack() as stack:
        threads = _start_threads(scenario, cameras, label_ids, recorder, stack)
        desk = _Desk(scenario, cameras, threads, recorder, stack, show=show, countdown=countdown)
        desk.wait_for_cameras()
        if desk.can_press:
            desk.run(_READY, until=desk.next_press())
        for seconds in range(countdown, 0, -1):
            desk.run(str(seconds), timeout=1.0)
        stopped: BaseException | None = None
        recorder.start()
        try:
            pressed = desk.next_press()
            desk.run(
                _RECORDING,
                until=lambda: pressed() or recorder.error is not None,
                timeout=duration / scenario.poil.hardware.time_scale,
            )
        except BaseException as error:  # KeyboardInterrupt, too; raised when the file is complete.
            stopped = error
        with HeldSignals():
            recorder.close()
            desk.show(_SAVED)
            stack.close()
            return _finish(recorder, threads, stopped)


def _start_threads(
    scenario: Scenario,
    cameras: Sequence[CameraModel],
    label_ids: Mapping[str, tuple[int, ...]],
    recorder: LiveRecorder,
    stack: ExitStack,
) -> dict[str, CaptureThread]:
    """Starts a thread for each camera that gives the recorder every image; `stack` ends them."""
    config, threads = scenario.poil.hardware, {}
    for camera in cameras:
        threads[camera.name] = CaptureThread(
            MakeCaptureDevice(
                config.cameras.get(camera.name, LcmImages()),
                scenario,
                camera,
                clock=config.clock(),
                label_ids=label_ids,
                every_image=True,
            ),
            name=camera.name,
            size=(camera.height, camera.width),
            on_image=partial(recorder.add, camera.name),
        )
    for thread in threads.values():
        stack.callback(thread.close)
        thread.start()
    return threads


class _Desk:
    """What a person sees of the cameras, on the page and in the terminal, and the keys."""

    def __init__(
        self,
        scenario: Scenario,
        cameras: Sequence[CameraModel],
        threads: Mapping[str, CaptureThread],
        recorder: LiveRecorder,
        stack: ExitStack,
        *,
        show: bool,
        countdown: int,
    ):
        """Opens page and terminal; `stack` closes them."""
        self._threads, self._recorder = threads, recorder
        self._hardware = scenario.poil.hardware
        self._clock, self._oldest = self._hardware.clock(), scenario.poil.safety.image_age_limit
        self._silent: set[str] = set()
        self._shown, self._show_again = "", -math.inf
        self._switch = StopSwitch()
        self._meshcat: Meshcat | None = None
        self._preview: CameraPreview | None = None
        if show:
            self._meshcat = MakeMeshcat()
            print(f"watch live: {self._meshcat.web_url()}", flush=True)
            numbers = [str(k) for k in range(countdown, 0, -1)]
            texts = [_WAITING, _READY, *numbers, _RECORDING, _SAVED]
            self._preview = CameraPreview(self._meshcat, cameras, texts=texts)
            self._meshcat.AddButton(BUTTON, BUTTON_KEY)
        listening = stack.enter_context(terminal_stop_key(self._switch, keys=_KEYS))
        self.can_press = listening or show
        ways = ["Enter or space"] * listening + [f"the button '{BUTTON}' on the page"] * show
        print(f"what starts and stops: {', '.join(ways) or 'no key (no terminal)'}", flush=True)
        print("what also stops, and keeps the recording: Ctrl-C", flush=True)
        self._line = stack.enter_context(StatusLine())

    def next_press(self) -> Callable[[], bool]:
        """Returns a function that returns whether a key or the button was pressed since now."""

        def presses() -> int:
            clicks = 0 if self._meshcat is None else self._meshcat.GetButtonClicks(BUTTON)
            return self._switch.requests + clicks

        before = presses()
        return lambda: presses() > before

    def wait_for_cameras(self) -> None:
        """Waits until each camera has delivered an image; raises a StationError if one does not."""

        def missing() -> list[str]:
            return [name for name, thread in self._threads.items() if thread.newest is None]

        timeout, sources = self._hardware.ready_timeout, self._hardware.cameras
        self.run(_WAITING, until=lambda: not missing(), timeout=timeout)
        if names := missing():
            problems = [f"'{name}' ({self._threads[name].problem or 'no image'})" for name in names]
            raise StationError(
                f"These cameras delivered nothing within {timeout:g} s: {', '.join(problems)}.",
                remedy="Check that they are plugged in or their senders are running, and their "
                "sources in poil.hardware.cameras.",
            )
        # The first recorded image shall have labels, if there are any.
        labelling = [
            record
            for name, record in self._recorder.records.items()
            if SendsLabels(sources.get(name, LcmImages()))
        ]
        self.run(
            _WAITING,
            until=lambda: all(record.labelled for record in labelling),
            timeout=LABEL_WAIT / self._hardware.time_scale,
        )

    def run(
        self, state: str, *, until: Callable[[], bool] = lambda: False, timeout: float = math.inf
    ) -> None:
        """Shows the state until a condition holds or the timeout [s] has passed."""
        start = time.monotonic()
        while not until() and time.monotonic() - start < timeout:
            if state != self._shown or time.monotonic() > self._show_again:
                self.show(state, time.monotonic() - start)
            time.sleep(_TICK)

    def show(self, state: str, elapsed: float = 0.0) -> None:
        """Shows the state, `elapsed` [s] after it began, and what the cameras deliver."""
        self._shown, self._show_again = state, time.monotonic() + _SHOW
        if self._preview is not None:
            self._preview.show_text(state)
            self._preview.show_images({name: t.newest for name, t in self._threads.items()})
        self._say_changes()
        parts = [state]
        if state == _RECORDING:
            path = self._recorder.path
            megabytes = path.stat().st_size / 1e6
            free = shutil.disk_usage(path.parent).free / 1e9
            seconds = elapsed * self._hardware.time_scale
            parts = [f"{state}, {seconds:.1f} s", f"{megabytes:.0f} MB, {free:.0f} GB free"]
        for name, record in self._recorder.records.items():
            parts.append(f"{name} {record.rate:.0f}/s, {_counts(record, self._threads[name])}")
        self._line(" | ".join(parts))

    def _say_changes(self) -> None:
        """Says which cameras have stopped, and which have come back."""
        found = camera_problems(self._threads, now=self._clock(), oldest=self._oldest)
        # A single unusable image is only counted.
        silent = {name for name in found if set(found[name]) - {self._threads[name].problem}}
        for name in sorted(silent - self._silent):
            self._line.say(f"camera '{name}': {'; '.join(found[name])}")
        for name in sorted(self._silent - silent):
            self._line.say(f"camera '{name}': images arrive again")
        self._silent = silent


def _counts(record: CameraRecord, thread: CaptureThread) -> str:
    """Returns how many images of a camera are in the file, and what became of the others."""
    counts = {
        "missing between the others": record.missing,
        "not written": record.lost,
        "with an earlier time": record.late,
        "unusable": thread.unusable,
    }
    found = [f"{count} {what}" for what, count in counts.items() if count]
    return ", ".join([f"{len(record.stamps)} images", *found])


def _finish(
    recorder: LiveRecorder, threads: Mapping[str, CaptureThread], stopped: BaseException | None
) -> Demonstration:
    """Loads what was recorded, prints a summary and draws the picture.

    Raises:
        DemonstrationError: if the file could not be completed, or it is no demonstration.
        BaseException: `stopped`, if it is not None.
    """
    path, stamps = recorder.path, []
    for name, record in recorder.records.items():
        print(f"{name:<10} {_counts(record, threads[name])}, {record.rate:.1f} per second")
        stamps += record.stamps
    if not stamps:
        path.unlink(missing_ok=True)
    if recorder.error is not None:
        reason = getattr(recorder.error, "strerror", None) or recorder.error
        span = max(stamps) - min(stamps) if stamps else 0.0
        raise DemonstrationError(
            f"The recording stopped after {span:.1f} s, because {path} could not be written "
            f"({reason}). {'Its images can be loaded' if stamps else 'It has no image'}.",
            remedy="Make room on the disk, or choose a file on another disk, and record again.",
        ) from recorder.error
    if not stamps:
        raise stopped or DemonstrationError(
            f"No camera delivered an image during the recording, so {path} was not written.",
            remedy="Check the cameras, and record again.",
        )
    print(f"recording  {path}", flush=True)
    recording = load_demonstration(path)
    picture = path.with_suffix(".png")
    contact_sheet(recording, picture)
    print(f"picture    {picture}", flush=True)
    print(f"recorded {len(recording.frames)} frames in {recording.duration:.1f} s", flush=True)
    if stopped is not None:
        raise stopped
    return recording

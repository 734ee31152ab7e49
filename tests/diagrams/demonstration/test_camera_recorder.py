import logging
import os
import pty
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_cameras import (
    FPS,
    HEIGHT,
    WIDTH,
    camera_models,
    images_of,
    lcm_sender,
    noise,
    number_of,
    scenario_text,
    sent_numbers,
    small_scenario,
    write_playback,
    write_streams,
)
from mcap.reader import make_reader
from network_bench import free_url

from poil_drake.diagrams.demonstration import camera_recorder
from poil_drake.diagrams.demonstration.camera_recorder import BUTTON, RecordFromCameras
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import DemonstrationError, StationError
from poil_drake.perception.images import RgbdImage
from poil_drake.recording.demonstration.demonstration import Demonstration, load_demonstration
from poil_drake.runtime.output_files import OutputError
from poil_drake.systems.cameras.lcm_image_messages import decode_images
from poil_drake.systems.lcm.network import LcmNetwork

PATIENCE = 600.0  # [s]; only a failing test waits that long.
READY, RECORDING = "ready: Space starts", "recording: Space stops"
NO_LABELS = "left: !LcmImages {labels: false}, right: !LcmImages {labels: false}"


@pytest.fixture
def url() -> str:
    return free_url()


def wait_for(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def is_gapless(numbers: list[int]) -> bool:
    return len(numbers) > 5 and numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def at_each_look(patch: pytest.MonkeyPatch, do: Callable[[camera_recorder._Desk], None]) -> None:
    """Calls `do` whenever the recorder looks at its keys."""
    show = camera_recorder._Desk.show

    def show_and_do(desk: camera_recorder._Desk, *args: object) -> None:
        show(desk, *args)
        do(desk)

    patch.setattr(camera_recorder._Desk, "show", show_and_do)
    patch.setattr(camera_recorder, "_SHOW", 0.05)


def record_images(scenario: Scenario, path: Path, count: int, **options: Any) -> Demonstration:
    """Records until every camera has at least `count` images in the file."""

    def stop(desk: camera_recorder._Desk) -> None:
        if min(len(record.stamps) for record in desk._recorder.records.values()) >= count:
            desk._switch.request()

    with pytest.MonkeyPatch.context() as patch:
        at_each_look(patch, stop)
        return RecordFromCameras(scenario, path, show=False, countdown=0, **options)


def test_the_file_holds_what_lcm_cameras_sent(url: str, tmp_path: Path) -> None:
    scenario = small_scenario(url)
    with lcm_sender(url, label_every=4) as sender:
        recording = record_images(scenario, tmp_path / "demo.mcap", 12, lossless=True)

    for name in ("left", "right"):
        assert is_gapless(sent_numbers(recording, name, sender.sent))
        labelled = [image.label is not None for image in images_of(recording, name)]
        assert labelled == [k % 4 == 0 for k in range(len(labelled))]  # The first one has labels.
    assert set(recording.frames[0].label_ids) >= {"mug", "mug/handle"}
    for loaded, model in zip(recording.cameras, camera_models(scenario), strict=True):
        assert loaded.name == model.name
        np.testing.assert_allclose(loaded.K, model.K)
        np.testing.assert_allclose(loaded.X_WC, model.X_WC, atol=1e-9)


def test_the_file_holds_what_streams_and_a_played_recording_deliver(
    url: str, tmp_path: Path
) -> None:
    _, right = camera_models(small_scenario(url))
    (tmp_path / "streams").mkdir()
    left_source = write_streams(tmp_path / "streams", count=600)
    right_source = write_playback(tmp_path / "played.mcap", right, count=12)
    scenario = small_scenario(url, f"left: {left_source}, right: {right_source}")

    recording = record_images(scenario, tmp_path / "demo.mcap", 15, lossless=True)

    read = [number_of(image, 600) for image in images_of(load(recording, "left"), "left")]
    assert is_gapless(read)
    played = images_of(load(recording, "right"), "right")
    numbers = [number_of(image, 12) for image in played]
    assert numbers == [k % 12 for k in range(len(numbers))]  # From the labelled image on.
    assert len(numbers) > 5
    np.testing.assert_allclose(np.diff([image.stamp for image in played]), 1.0 / FPS, atol=1e-6)


def load(recording: Demonstration, camera: str) -> Demonstration:
    """Loads one camera, because frames of two would skip images without a partner."""
    return load_demonstration(recording.name, cameras=[camera])


def test_by_default_colour_is_jpeg_and_depth_is_in_millimetres(url: str, tmp_path: Path) -> None:
    with lcm_sender(url) as sender:
        recording = RecordFromCameras(
            small_scenario(url, NO_LABELS),
            tmp_path / "d.mcap",
            show=False,
            countdown=0,
            duration=1.0,
        )

    for image in images_of(recording, "right"):
        sent = noise(sender.sent[round(1e3 * image.stamp)])
        np.testing.assert_allclose(image.depth, sent.depth, atol=1e-6)
        assert 1.0 < np.abs(image.rgb.astype(float) - sent.rgb).mean() < 64.0  # Noise, as JPEG.


@pytest.fixture
def small_disk() -> Iterator[None]:
    """Lets no file grow beyond 200 kB."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("small_disk")
def test_what_a_full_disk_holds_can_be_loaded(
    url: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "demo.mcap"
    with (
        lcm_sender(url) as sender,
        pytest.raises(DemonstrationError, match=r"could not be written \(File too large\)"),
    ):
        RecordFromCameras(
            small_scenario(url, NO_LABELS), path, show=False, countdown=0, lossless=True
        )

    with caplog.at_level(logging.WARNING):
        recording = load_demonstration(path)

    assert "demo.mcap is cut off" in caplog.text
    numbers = sent_numbers(recording, "left", sender.sent)
    # An image of each camera takes 21 kB, and a chunk at most 64 kB more than the file's last one.
    assert len(numbers) >= 2
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_an_unplugged_camera_is_named_and_goes_on_when_it_is_back(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    states = iter(["recording", "unplugged", "plugged in again", "end"])
    state = next(states)
    with lcm_sender(url) as sender:

        def unplug(desk: camera_recorder._Desk) -> None:
            nonlocal state
            counts = [len(record.stamps) for record in desk._recorder.records.values()]
            if state == "recording" and min(counts) > 5 and not desk._silent:
                sender.plugged.clear()
                state = next(states)
            elif state == "unplugged" and desk._silent == {"left", "right"}:
                sender.plugged.set()
                state = next(states)
            elif state == "plugged in again" and not desk._silent:
                desk._switch.request()
                state = next(states)

        with pytest.MonkeyPatch.context() as patch:
            at_each_look(patch, unplug)
            recording = RecordFromCameras(
                small_scenario(url, NO_LABELS),
                tmp_path / "demo.mcap",
                show=False,
                countdown=0,
                lossless=True,
            )

    assert is_gapless(sent_numbers(recording, "left", sender.sent))
    assert np.diff(recording.stamps).max() > 0.4
    said = capsys.readouterr().out
    assert "camera 'left': no new image for 0." in said
    assert "camera 'left': images arrive again" in said
    assert "missing between the others" in said


def test_the_button_starts_and_stops(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    states = []

    def click(desk: camera_recorder._Desk) -> None:
        states.append(desk._shown)
        recorded = len(desk._recorder.records["left"].stamps)
        is_ready = desk._shown == READY and states.count(READY) == 3
        if is_ready or (desk._shown == RECORDING and recorded > 5):
            name = BUTTON.encode()
            desk._meshcat._InjectWebsocketMessage(
                message=b"\x82\xa4type\xa6button\xa4name" + bytes([0xA0 + len(name)]) + name
            )
            states.append("click")

    at_each_look(monkeypatch, click)
    with lcm_sender(url):
        recording = RecordFromCameras(
            small_scenario(url, NO_LABELS), tmp_path / "d.mcap", countdown=1
        )

    assert len(recording.frames) > 5
    order = list(dict.fromkeys(state for state in states if state != "waiting for cameras"))
    assert order == [READY, "click", "1", RECORDING, "saved"]


def test_keys_start_and_stop(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    typing, terminal = pty.openpty()
    typed = 0

    def press(desk: camera_recorder._Desk) -> None:
        nonlocal typed
        recorded = len(desk._recorder.records["left"].stamps)
        if (desk._shown == READY and typed == 0) or (recorded > 5 and typed == 1):
            os.write(typing, b"q\n")
            typed += 1

    at_each_look(monkeypatch, press)
    with os.fdopen(terminal, "r") as stream, lcm_sender(url):
        monkeypatch.setattr("sys.stdin", stream)
        recording = RecordFromCameras(
            small_scenario(url, NO_LABELS), tmp_path / "d.mcap", show=False, countdown=0
        )
    os.close(typing)

    assert typed == 2
    assert len(recording.frames) > 5


def test_a_camera_that_delivers_nothing_is_named(url: str, tmp_path: Path) -> None:
    right = "right: !OpenCvStreams {rgb: 'a_%d.png', depth: 'd_%d.png'}"
    scenario = small_scenario(url, right, ready_timeout=0.5)
    with (
        lcm_sender(url, ["left"]),
        pytest.raises(StationError, match=r"nothing within .*'right' \(.*cannot open 'a_%d\.png'"),
    ):
        RecordFromCameras(scenario, tmp_path / "d.mcap", show=False, duration=0.1)

    assert list(tmp_path.iterdir()) == []


def test_a_recording_is_never_overwritten(url: str, tmp_path: Path) -> None:
    path = tmp_path / "demo.mcap"
    path.write_bytes(b"the last take")

    with pytest.raises(OutputError, match=r"demo\.mcap' exists already"):
        RecordFromCameras(small_scenario(url), path, show=False)

    assert path.read_bytes() == b"the last take"


@pytest.fixture
def record(url: str, tmp_path: Path) -> Iterator[Callable[[], subprocess.Popen[str]]]:
    """Starts `poil demo record --hardware` in another process."""
    processes: list[subprocess.Popen[str]] = []

    def start() -> subprocess.Popen[str]:
        program = Path(sys.executable).with_name("poil")
        options = ["--hardware", "--no-meshcat", "--countdown", "0", "--lossless"]
        options += ["--scenario_text", scenario_text(url, NO_LABELS), "-o", "demo.mcap"]
        process = subprocess.Popen(
            [program, "demo", "record", *options],
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def end_while_recording(
    process: subprocess.Popen[str], path: Path, number: signal.Signals
) -> tuple[str, str]:
    """Sends a signal once the file has some frames; returns what the process wrote."""
    wait_for(
        lambda: (path.exists() and path.stat().st_size > 400_000) or process.poll() is not None
    )
    process.send_signal(number)
    return process.communicate()


def test_a_killed_recording_can_be_loaded(
    url: str, tmp_path: Path, record: Callable[[], subprocess.Popen[str]]
) -> None:
    path = tmp_path / "demo.mcap"
    with lcm_sender(url) as sender:
        end_while_recording(record(), path, signal.SIGKILL)

    recording = load_demonstration(path)

    numbers = sent_numbers(recording, "left", sender.sent)
    assert is_gapless(numbers)
    # Each frame takes 42 kB; the last chunk, of up to 64 kB and an image, may be cut off.
    assert len(numbers) >= 6


def test_ctrl_c_keeps_a_complete_file(
    url: str, tmp_path: Path, record: Callable[[], subprocess.Popen[str]]
) -> None:
    path = tmp_path / "demo.mcap"
    with lcm_sender(url) as sender:
        process = record()
        out, err = end_while_recording(process, path, signal.SIGINT)

    assert (process.returncode, err) == (130, "poil: stopped by the user\n")
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    recording = load_demonstration(path)
    assert is_gapless(sent_numbers(recording, "right", sender.sent))
    assert f"recorded {len(recording.frames)} frames" in out
    assert path.with_suffix(".png").stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.render
def test_the_file_holds_what_the_simulated_drivers_cameras_sent(url: str, tmp_path: Path) -> None:
    """The driver's images are also received here, as another program of the laboratory would."""
    text = scenario_text(url, robot_url=free_url())
    heard: dict[str, list[RgbdImage]] = {"left": [], "right": []}
    network = LcmNetwork(url)
    for name, images in heard.items():

        def hear(message: bytes, images: list[RgbdImage] = images) -> None:
            images.append(decode_images(message, size=(HEIGHT, WIDTH)))

        network.Subscribe(f"DRAKE_RGBD_CAMERA_IMAGES_{name}", hear)
    program = Path(sys.executable).with_name("poil")
    driver = subprocess.Popen([program, "driver", "--scenario_text", text], cwd=tmp_path)
    try:
        recording = record_images(
            ChooseScenario(data=text), tmp_path / "demo.mcap", 12, lossless=True
        )
    finally:
        driver.kill()
        driver.wait()
    network.HandleSubscriptions(0)

    assert all(image.label is not None for image in recording.frames[0].images)
    for name, images in heard.items():
        found = images_of(recording, name)
        first, last = found[0].stamp - 1e-5, found[-1].stamp + 1e-5
        sent = [image for image in images if first < image.stamp < last]
        assert len(found) > 3
        for one, other in zip(found, sent, strict=True):
            assert abs(one.stamp - other.stamp) < 1e-5
            np.testing.assert_array_equal(one.rgb, other.rgb)
            np.testing.assert_array_equal(one.depth, other.depth)
            assert (one.label is None) == (other.label is None)
            if one.label is not None:
                np.testing.assert_array_equal(one.label, other.label)

import logging
import os
import pty
import resource
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from live_cameras import (
    FPS,
    HEIGHT,
    MUG,
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
from poil_drake.errors import DemonstrationError, StationError
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.runtime.output_files import OutputError
from poil_drake.systems.cameras.lcm_image_messages import decode_images
from poil_drake.systems.lcm.network import LcmNetwork

PATIENCE = 600.0  # [s]; only a failing test waits that long.
READY, RECORDING = "ready: Space starts", "recording: Space stops"
NO_LABELS = "left: !LcmImages {labels: false}, right: !LcmImages {labels: false}"
PROGRAM = Path(sys.executable).with_name("poil")


@pytest.fixture
def url():
    return free_url()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "demo.mcap"


def is_gapless(numbers):
    return len(numbers) > 5 and numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def record(scenario, path, **options):
    options = {"show": False, "countdown": 0, "lossless": True} | options
    return RecordFromCameras(scenario, path, **options)


@contextmanager
def at_each_look(do):
    """Calls `do` with the recorder's desk whenever it looks at its keys."""
    show = camera_recorder._Desk.show

    def show_and_do(desk, *args):
        show(desk, *args)
        do(desk)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(camera_recorder._Desk, "show", show_and_do)
        patch.setattr(camera_recorder, "_SHOW", 0.05)
        yield


def recorded(desk):
    """Returns how many images of each camera, or more, are in the file."""
    return min(len(record.stamps) for record in desk._recorder.records.values())


def record_images(scenario, path, count):
    """Records until every camera has at least `count` images in the file."""
    with at_each_look(lambda desk: recorded(desk) >= count and desk._switch.request()):
        return record(scenario, path)


def test_the_file_holds_what_lcm_cameras_sent(url, path):
    scenario = small_scenario(url)
    with lcm_sender(url, label_every=4) as sender:
        recording = record_images(scenario, path, 12)

    for name in ("left", "right"):
        assert is_gapless(sent_numbers(recording, name, sender.sent))
        labelled = [image.label is not None for image in images_of(recording, name)]
        assert labelled == [k % 4 == 0 for k in range(len(labelled))]  # The first one has labels.
    assert set(recording.frames[0].label_ids) >= {"mug", "mug/handle"}
    for loaded, model in zip(recording.cameras, camera_models(scenario), strict=True):
        assert loaded.name == model.name
        np.testing.assert_allclose(loaded.K, model.K)
        np.testing.assert_allclose(loaded.X_WC, model.X_WC, atol=1e-9)


def test_the_file_holds_what_streams_and_a_played_recording_deliver(url, path):
    _, right = camera_models(small_scenario(url))
    left_source = write_streams(path.parent, count=600)
    right_source = write_playback(path.with_name("played.mcap"), right, count=12)
    scenario = small_scenario(url, f"left: {left_source}, right: {right_source}")

    label_ids = record_images(scenario, path, 15).frames[0].label_ids

    # One camera at a time, because frames of two would skip images without a partner.
    left, played = (
        images_of(load_demonstration(path, cameras=[name]), name) for name in ("left", "right")
    )
    assert is_gapless([number_of(image, 600) for image in left])
    numbers = [number_of(image, 12) for image in played]
    assert numbers == [k % 12 for k in range(len(numbers))]  # From the labelled image on.
    assert len(numbers) > 5
    # In the recording that is played, the mug has another number than in the scenario.
    assert set(played[0].label.ravel()) <= set(label_ids["mug"]) - {MUG}
    np.testing.assert_allclose(np.diff([image.stamp for image in played]), 1.0 / FPS, atol=1e-6)


def test_by_default_colour_is_jpeg_and_depth_is_in_millimetres(url, path):
    with lcm_sender(url) as sender:
        recording = record(small_scenario(url, NO_LABELS), path, lossless=False, duration=1.0)

    for image in images_of(recording, "right"):
        sent = noise(sender.sent[round(1e3 * image.stamp)])
        np.testing.assert_allclose(image.depth, sent.depth, atol=1e-6)
        assert 1.0 < np.abs(image.rgb.astype(float) - sent.rgb).mean() < 64.0  # Noise, as JPEG.


@pytest.fixture
def small_disk():
    """Lets no file grow beyond 200 kB."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("small_disk")
def test_what_a_full_disk_holds_can_be_loaded(url, path, caplog):
    with (
        lcm_sender(url) as sender,
        pytest.raises(DemonstrationError, match=r"could not be written \(File too large\)"),
    ):
        record(small_scenario(url, NO_LABELS), path)

    with caplog.at_level(logging.WARNING):
        recording = load_demonstration(path)

    assert "demo.mcap is cut off" in caplog.text
    numbers = sent_numbers(recording, "left", sender.sent)
    # An image of each camera takes 21 kB, and a chunk at most 64 kB more than the file's last one.
    assert len(numbers) >= 2
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_an_unplugged_camera_is_named_and_goes_on_when_it_is_back(url, path, capsys):
    states = iter(["recording", "unplugged", "plugged in again", "end"])
    state = next(states)
    with lcm_sender(url) as sender:

        def unplug(desk):
            nonlocal state
            if state == "recording" and recorded(desk) > 5 and not desk._silent:
                sender.plugged.clear()
                state = next(states)
            elif state == "unplugged" and desk._silent == {"left", "right"}:
                sender.plugged.set()
                state = next(states)
            elif state == "plugged in again" and not desk._silent:
                desk._switch.request()
                state = next(states)

        with at_each_look(unplug):
            recording = record(small_scenario(url, NO_LABELS), path)

    assert is_gapless(sent_numbers(recording, "left", sender.sent))
    assert np.diff(recording.stamps).max() > 0.4
    said = capsys.readouterr().out
    assert "camera 'left': no new image for 0." in said
    assert "camera 'left': images arrive again" in said
    assert "missing between the others" in said


def test_the_button_starts_and_stops(url, path):
    states = []

    def click(desk):
        states.append(desk._shown)
        is_ready = desk._shown == READY and states.count(READY) == 3
        if is_ready or (desk._shown == RECORDING and recorded(desk) > 5):
            name = BUTTON.encode()
            desk._meshcat._InjectWebsocketMessage(
                message=b"\x82\xa4type\xa6button\xa4name" + bytes([0xA0 + len(name)]) + name
            )
            states.append("click")

    with at_each_look(click), lcm_sender(url):
        recording = record(small_scenario(url, NO_LABELS), path, show=True, countdown=1)

    assert len(recording.frames) > 5
    order = list(dict.fromkeys(state for state in states if state != "waiting for cameras"))
    assert order == [READY, "click", "1", RECORDING, "saved"]


def test_keys_start_and_stop(url, path, monkeypatch):
    typing, terminal = pty.openpty()
    typed = 0

    def press(desk):
        nonlocal typed
        if (desk._shown == READY and typed == 0) or (recorded(desk) > 5 and typed == 1):
            os.write(typing, b"q\n")
            typed += 1

    with at_each_look(press), os.fdopen(terminal, "r") as stream, lcm_sender(url):
        monkeypatch.setattr("sys.stdin", stream)
        recording = record(small_scenario(url, NO_LABELS), path)
    os.close(typing)

    assert typed == 2
    assert len(recording.frames) > 5


def test_a_camera_that_delivers_nothing_is_named(url, path):
    right = "right: !OpenCvStreams {rgb: 'a_%d.png', depth: 'd_%d.png'}"
    scenario = small_scenario(url, right, ready_timeout=0.5)
    with (
        lcm_sender(url, ["left"]),
        pytest.raises(StationError, match=r"nothing within .*'right' \(.*cannot open 'a_%d\.png'"),
    ):
        record(scenario, path, duration=0.1)

    assert list(path.parent.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "said"),
    [("demo.mcap", r"demo\.mcap' exists already"), ("demo.png", r"demo\.png' would overwrite")],
)
def test_a_recording_is_never_overwritten(url, path, name, said):
    path.write_bytes(b"the last take")

    with pytest.raises(OutputError, match=said):
        record(small_scenario(url), path.with_name(name))

    assert path.read_bytes() == b"the last take"


@pytest.fixture
def ended(url, path):
    """Ends `poil demo record --hardware` by a signal once it has recorded some frames."""
    processes = []

    def end(number):
        options = ["--hardware", "--no-meshcat", "--countdown", "0", "--lossless"]
        options += ["--scenario_text", scenario_text(url, NO_LABELS), "-o", "demo.mcap"]
        process = subprocess.Popen(
            [PROGRAM, "demo", "record", *options],
            cwd=path.parent,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        deadline = time.monotonic() + PATIENCE
        while process.poll() is None and not (path.exists() and path.stat().st_size > 400_000):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(number)
        out, err = process.communicate()
        return process.returncode, out, err

    yield end
    for process in processes:
        process.kill()
        process.communicate()


def test_a_killed_recording_can_be_loaded(url, path, ended):
    with lcm_sender(url) as sender:
        ended(signal.SIGKILL)

    numbers = sent_numbers(load_demonstration(path), "left", sender.sent)

    assert is_gapless(numbers)
    # Each frame takes 42 kB; the last chunk, of up to 64 kB and an image, may be cut off.
    assert len(numbers) >= 6


def test_ctrl_c_keeps_a_complete_file(url, path, ended):
    with lcm_sender(url) as sender:
        status, out, err = ended(signal.SIGINT)

    assert (status, err) == (130, "poil: stopped by the user\n")
    with path.open("rb") as stream:
        assert make_reader(stream).get_summary().statistics is not None
    recording = load_demonstration(path)
    assert is_gapless(sent_numbers(recording, "right", sender.sent))
    assert f"recorded {len(recording.frames)} frames" in out
    assert path.with_suffix(".png").stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.render
def test_the_file_holds_what_the_simulated_drivers_cameras_sent(url, path):
    """The driver's images are also received here, as another program of the laboratory would."""
    text = scenario_text(url, robot_url=free_url())
    heard = {"left": [], "right": []}
    network = LcmNetwork(url)
    for name, images in heard.items():

        def hear(message, images=images):
            images.append(decode_images(message, size=(HEIGHT, WIDTH)))

        network.Subscribe(f"DRAKE_RGBD_CAMERA_IMAGES_{name}", hear)
    driver = subprocess.Popen([PROGRAM, "driver", "--scenario_text", text], cwd=path.parent)
    try:
        recording = record_images(ChooseScenario(data=text), path, 12)
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

import threading
from collections.abc import Iterator

import pytest
from capture_bench import SIZE, TIMEOUT, ScriptedDevice, image

from poil_drake.errors import CaptureError, NoImageError, NoMoreImagesError
from poil_drake.perception.capture import capture_thread
from poil_drake.perception.capture.capture_thread import CaptureThread
from poil_drake.perception.images import RgbdImage

GARBAGE = NoImageError("Camera 'left' delivers garbage.", remedy="Keep others off.")
UNPLUGGED = CaptureError("Camera 'left' is unplugged.", remedy="Plug it in.")


@pytest.fixture
def device() -> ScriptedDevice:
    return ScriptedDevice()


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capture_thread, "_JOIN_TIMEOUT", TIMEOUT)


def make(device: ScriptedDevice, *, reopen_period: float = 0.01) -> CaptureThread:
    return CaptureThread(device, name="left", size=SIZE, reopen_period=reopen_period)


@pytest.fixture
def dut(device: ScriptedDevice) -> Iterator[CaptureThread]:
    """A thread that reads the device."""
    thread = make(device)
    thread.start()
    yield thread
    thread.close()


def test_there_is_no_image_before_the_first(device: ScriptedDevice, dut: CaptureThread) -> None:
    device.wait_until_opened(1)

    assert (dut.newest, dut.count, dut.problem) == (None, 0, "")


def test_the_newest_image_is_kept(device: ScriptedDevice, dut: CaptureThread) -> None:
    images = [image(1.0), image(2.0), image(3.0)]
    device.feed(*images)

    assert dut.newest is images[-1]
    assert (dut.count, dut.problem) == (3, "")


def test_every_usable_image_is_passed_on_and_the_others_are_counted(
    device: ScriptedDevice,
) -> None:
    found: list[RgbdImage] = []
    dut = CaptureThread(device, name="left", size=SIZE, on_image=found.append)
    images = [image(1.0), image(2.0), image(4.0)]
    ended = NoMoreImagesError("The file has ended.", remedy="Loop it.")

    dut.start()
    device.feed(*images[:2], GARBAGE, image(2.0), image(3.0, depth=0.0), images[2], ended, ended)
    dut.close()

    assert found == images
    assert (dut.count, dut.unusable) == (3, 3)


def test_one_daemon_thread_with_the_cameras_name_calls_the_device_until_close(
    device: ScriptedDevice, dut: CaptureThread
) -> None:
    device.feed(image(1.0), UNPLUGGED, image(2.0))
    dut.close()
    dut.close()

    (thread,) = device.threads
    assert thread is not threading.current_thread()
    assert (thread.name, thread.daemon, thread.is_alive()) == ("capture_left", True, False)
    assert device.closed == 2
    assert dut.newest is not None


@pytest.mark.parametrize(
    ("unusable", "problem"),
    [
        (image(5.0), "frozen"),
        (image(4.0), "4.000 s came after one stamped 5.000 s"),
        (image(float("nan")), "the stamp nan"),
        (image(float("inf")), "the stamp inf"),
        (image(6.0, size=(3, 4)), "4 x 3 pixels, but the scenario has 8 x 6"),
        (image(6.0, depth=0.0), "empty"),
        (GARBAGE, "Camera 'left' delivers garbage. Keep others off"),
    ],
    ids=["frozen", "backwards", "nan", "infinite", "size", "no depth", "rejected by the device"],
)
def test_an_unusable_image_is_reported_and_the_next_one_clears_the_problem(
    device: ScriptedDevice, dut: CaptureThread, unusable: RgbdImage | NoImageError, problem: str
) -> None:
    device.feed(image(5.0), unusable, unusable)

    assert dut.newest is not None
    assert (dut.newest.stamp, dut.count) == (5.0, 1)
    assert problem in dut.problem

    device.feed(image(7.0))

    assert (dut.newest.stamp, dut.count, dut.problem) == (7.0, 2, "")
    assert (device.opened, device.closed) == (1, 0)


def test_an_unplugged_camera_is_reported_and_opened_again(
    device: ScriptedDevice, dut: CaptureThread
) -> None:
    device.feed(image(1.0))
    device.fail_to_open(UNPLUGGED, UNPLUGGED)

    device.feed(UNPLUGGED)
    device.wait_until_opened(3)

    assert dut.newest is not None
    assert dut.newest.stamp == 1.0
    assert dut.problem == "Camera 'left' is unplugged. Plug it in"

    device.feed(image(2.0))

    assert (dut.newest.stamp, dut.problem) == (2.0, "")
    assert (device.opened, device.closed) == (4, 3)


def test_a_camera_opened_again_may_have_an_earlier_clock(
    device: ScriptedDevice, dut: CaptureThread
) -> None:
    device.feed(image(5.0), UNPLUGGED, image(4.0))

    assert dut.newest is not None
    assert (dut.newest.stamp, dut.problem) == (4.0, "")


def test_a_failed_camera_is_closed_only_before_it_is_opened_again(device: ScriptedDevice) -> None:
    device.fail_to_open(UNPLUGGED)
    dut = make(device, reopen_period=1e6)
    dut.start()
    device.wait_until_opened(1)

    assert device.closed == 0

    dut.close()  # It does not wait for the next attempt.
    assert device.closed == 1
    assert not any(thread.is_alive() for thread in device.threads)


@pytest.mark.parametrize(
    "error",
    [
        RuntimeError("USB\n  gone"),
        OSError(19, "No such device"),
        AttributeError("x"),
        MemoryError(),
    ],
    ids=lambda error: type(error).__name__,
)
def test_no_type_of_error_ends_the_thread(
    device: ScriptedDevice, dut: CaptureThread, error: Exception
) -> None:
    device.feed(error)

    assert dut.problem.startswith(type(error).__name__)
    assert "\n" not in dut.problem

    device.fail_to_open(error)
    device.feed(error, image(1.0))

    assert (dut.count, dut.problem) == (1, "")


def test_a_device_that_cannot_be_closed_is_opened_again(
    device: ScriptedDevice, dut: CaptureThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    def close() -> None:
        raise RuntimeError("stuck")

    monkeypatch.setattr(device, "close", close)
    device.feed(UNPLUGGED, image(1.0))

    assert (dut.count, dut.problem) == (1, "")


def test_close_before_start_does_not_touch_the_device(device: ScriptedDevice) -> None:
    dut = make(device)
    dut.close()
    dut.start()
    dut.close()

    assert device.threads == set()


def test_close_does_not_wait_for_a_thread_that_hangs_in_its_device(
    device: ScriptedDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside, go_on = threading.Event(), threading.Event()

    def hang() -> None:
        inside.set()
        go_on.wait(TIMEOUT)

    monkeypatch.setattr(device, "open", hang)
    monkeypatch.setattr(capture_thread, "_JOIN_TIMEOUT", 0.01)
    dut = make(device)
    dut.start()
    assert inside.wait(TIMEOUT)

    dut.close()

    assert device.closed == 0
    go_on.set()
    (thread,) = [t for t in threading.enumerate() if t.name == "capture_left"]
    thread.join(TIMEOUT)
    assert device.closed == 1

import numpy as np
import pytest
from network_bench import free_url
from pydrake.lcm import DrakeLcm

from poil_drake.errors import CaptureError, NoImageError
from poil_drake.perception.images import RgbdImage
from poil_drake.systems.cameras import lcm_image_device
from poil_drake.systems.cameras.lcm_image_device import LcmImageDevice
from poil_drake.systems.cameras.lcm_image_messages import encode_images
from poil_drake.systems.lcm.network import LcmNetwork

H, W = 4, 6


def message(stamp: float) -> bytes:
    rgb, depth = np.zeros((H, W, 3), np.uint8), np.ones((H, W), np.float32)
    return encode_images(RgbdImage(rgb, depth, stamp), camera="left")


@pytest.fixture
def url() -> str:
    return free_url()


@pytest.fixture
def dut(url: str, monkeypatch: pytest.MonkeyPatch) -> LcmImageDevice:
    monkeypatch.setattr(lcm_image_device, "_PATIENCE", 3_600_000)
    return LcmImageDevice(url=url, channel="CAMERA", size=(H, W))


def test_images_of_the_channel_are_read(dut: LcmImageDevice, url: str) -> None:
    dut.open()
    dut.close()
    dut.close()
    dut.open()  # It can be opened again.
    sender = DrakeLcm(url)
    sender.Publish("OTHER", message(9.0))
    sender.Publish("CAMERA", message(1.0))

    found = dut.read()

    assert found is not None
    assert found.stamp == 1.0


def test_of_three_queued_images_the_newest_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    networks: list[LcmNetwork] = []

    class Kept(LcmNetwork):
        def __init__(self, url: str, *, queue_capacity: int):
            super().__init__(url, queue_capacity=queue_capacity)
            networks.append(self)

    monkeypatch.setattr(lcm_image_device, "LcmNetwork", Kept)
    # In memory, so that all three are queued before the first is read.
    dut = LcmImageDevice(url="memq://", channel="CAMERA", size=(H, W))
    dut.open()
    for stamp in (1.0, 2.0, 3.0):
        networks[0].Publish("CAMERA", message(stamp))

    found = dut.read()

    assert found is not None
    assert found.stamp == 3.0


def test_a_silent_channel_has_no_image(
    dut: LcmImageDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lcm_image_device, "_PATIENCE", 100)
    dut.open()

    assert dut.read() is None


def test_garbage_is_reported_and_the_next_image_is_read(dut: LcmImageDevice, url: str) -> None:
    dut.open()
    sender = DrakeLcm(url)
    sender.Publish("CAMERA", b"garbage")
    with pytest.raises(NoImageError, match="no lcmt_image_array"):
        dut.read()
    sender.Publish("CAMERA", message(2.0))

    found = dut.read()

    assert found is not None
    assert found.stamp == 2.0


def test_it_must_be_open_to_be_read(dut: LcmImageDevice) -> None:
    with pytest.raises(CaptureError, match="CAMERA is not open"):
        dut.read()

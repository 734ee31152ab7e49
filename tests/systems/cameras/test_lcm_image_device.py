import socket

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm

from poil_drake.errors import CaptureError, NoImageError
from poil_drake.perception.images import RgbdImage
from poil_drake.systems.cameras import lcm_image_device
from poil_drake.systems.cameras.lcm_image_device import LcmImageDevice
from poil_drake.systems.cameras.lcm_image_messages import encode_images
from poil_drake.systems.lcm.network import LcmNetwork

H, W = 4, 6


def free_url() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        port = taken.getsockname()[1]
    return f"udpm://239.255.76.67:{port}?ttl=0"


def image(stamp: float) -> RgbdImage:
    rgb = np.zeros((H, W, 3), np.uint8)
    return RgbdImage(rgb=rgb, depth=np.ones((H, W), np.float32), stamp=stamp)


@pytest.fixture
def url() -> str:
    return free_url()


@pytest.fixture
def dut(url: str, monkeypatch: pytest.MonkeyPatch) -> LcmImageDevice:
    monkeypatch.setattr(lcm_image_device, "_PATIENCE", 3_600_000)
    return LcmImageDevice(url=url, channel="CAMERA", size=(H, W))


def test_images_of_the_channel_are_read(dut: LcmImageDevice, url: str) -> None:
    dut.open()
    sender = DrakeLcm(url)
    sender.Publish("OTHER", encode_images(image(9.0), camera="other"))
    sender.Publish("CAMERA", encode_images(image(1.0), camera="left"))

    found = dut.read()

    assert found is not None
    assert found.stamp == 1.0


def test_of_three_that_wait_the_newest_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    networks: list[LcmNetwork] = []

    class Kept(LcmNetwork):
        def __init__(self, url: str, *, queue_capacity: int):
            super().__init__(url, queue_capacity=queue_capacity)
            networks.append(self)

    monkeypatch.setattr(lcm_image_device, "LcmNetwork", Kept)
    # In memory, so that all three wait before the first is read.
    dut = LcmImageDevice(url="memq://", channel="CAMERA", size=(H, W))
    dut.open()
    for stamp in (1.0, 2.0, 3.0):
        networks[0].Publish("CAMERA", encode_images(image(stamp), camera="left"))

    found = dut.read()

    assert found is not None
    assert found.stamp == 3.0


def test_nothing_comes_from_a_silent_channel(
    dut: LcmImageDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lcm_image_device, "_PATIENCE", 100)
    dut.open()

    assert dut.read() is None


def test_garbage_is_reported(dut: LcmImageDevice, url: str) -> None:
    dut.open()
    DrakeLcm(url).Publish("CAMERA", b"garbage")

    with pytest.raises(NoImageError, match="not an lcmt_image_array"):
        dut.read()


def test_a_good_image_after_garbage_is_shown_at_once(dut: LcmImageDevice, url: str) -> None:
    dut.open()
    sender = DrakeLcm(url)
    sender.Publish("CAMERA", b"garbage")
    with pytest.raises(NoImageError):
        dut.read()
    sender.Publish("CAMERA", encode_images(image(2.0), camera="left"))

    found = dut.read()

    assert found is not None
    assert found.stamp == 2.0


def test_it_can_be_opened_again(dut: LcmImageDevice, url: str) -> None:
    dut.open()
    dut.close()
    dut.close()
    dut.open()
    DrakeLcm(url).Publish("CAMERA", encode_images(image(2.0), camera="left"))

    found = dut.read()

    assert found is not None
    assert found.stamp == 2.0


def test_it_must_be_open_to_be_read(dut: LcmImageDevice) -> None:
    with pytest.raises(CaptureError, match="CAMERA is not open"):
        dut.read()

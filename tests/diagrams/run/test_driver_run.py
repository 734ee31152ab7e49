"""The simulated driver as a process runs it: in real time, over a real network."""

import json
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from pydrake.manipulation import PandaControlMode
from short_skill import HOME, short_scenario

from poil_drake.benchmarks.hardware.stand_in_robot import with_own_networks
from poil_drake.diagrams.run import driver_run
from poil_drake.diagrams.run.driver_run import DriverSummary, RunDriver
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import StationError
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import LcmNetwork
from poil_drake.systems.lcm.panda_messages import (
    PandaStatus,
    decode_hand_status,
    decode_panda_status,
    encode_panda_command,
)

pytestmark = pytest.mark.real_time


class Client:
    """Receives the statuses of the driver, and sends commands to it."""

    def __init__(self, scenario: Scenario):
        self.lcm = LcmNetwork(scenario.lcm_buses["robot"].lcm_url)
        self.arm = LcmMailbox(self.lcm, "PANDA_STATUS", decode_panda_status)
        self.hand = LcmMailbox(self.lcm, "PANDA_HAND_STATUS", decode_hand_status)
        self.stamps: list[float] = []
        self.lcm.Subscribe(
            "PANDA_STATUS", lambda raw: self.stamps.append(decode_panda_status(raw).stamp)
        )

    def status(self) -> PandaStatus:
        while self.arm.newest is None:
            self.lcm.HandleSubscriptions(100)
        return self.arm.newest


@pytest.fixture
def scenario() -> Scenario:
    return with_own_networks(short_scenario())


def test_it_reports_and_ends_after_its_duration(scenario: Scenario, tmp_path: Path) -> None:
    client, said = Client(scenario), []

    summary = RunDriver(scenario, duration=0.5, json=tmp_path / "driver.json", say=said.append)

    client.lcm.HandleSubscriptions(0)
    np.testing.assert_allclose(client.arm.newest.position, HOME, atol=1e-3)
    assert len(client.stamps) in (512, 513)
    assert client.hand.newest.width == pytest.approx(0.08, abs=1e-3)
    assert scenario.lcm_buses["robot"].lcm_url in said[0]
    assert said[1:] == ["in the simulation the mug does not hang on the rack"]
    assert (summary.hangs, summary.simulated) == (False, 0.5)
    assert json.loads((tmp_path / "driver.json").read_text())["reason"] == "the duration has passed"


def test_the_time_scale_slows_the_stamps_down_too() -> None:
    scenario = with_own_networks(short_scenario("{poil: {hardware: {time_scale: 0.5}}}"))
    client = Client(scenario)

    RunDriver(scenario, duration=0.25, say=lambda line: None)

    client.lcm.HandleSubscriptions(0)
    # The simulation may be late, but the clock of its stamps is half as fast as the wall clock.
    assert client.stamps[-1] - client.stamps[0] >= 0.25 - 2e-3
    assert client.stamps[-1] == pytest.approx(scenario.poil.hardware.clock()(), abs=60.0)


def test_a_command_in_another_mode_ends_it_like_the_real_driver(
    scenario: Scenario, tmp_path: Path
) -> None:
    client = Client(scenario)

    def command() -> None:
        status = client.status()
        message = bytearray(encode_panda_command(np.zeros(7), status.stamp))
        message[-1] = int(PandaControlMode.kTorque)
        client.lcm.Publish("PANDA_COMMAND", bytes(message))

    thread = threading.Thread(target=command, daemon=True)
    thread.start()
    with pytest.raises(StationError, match="cannot follow a command with the control mode 4"):
        RunDriver(scenario, duration=3600.0, json=tmp_path / "driver.json", say=lambda line: None)
    thread.join()

    summary = DriverSummary(**json.loads((tmp_path / "driver.json").read_text()))
    assert "cannot follow a command with the control mode 4" in summary.reason
    assert summary.simulated < 3600.0


def test_a_second_signal_does_not_lose_the_summary(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_interrupted(data: dict[str, object], path: Path) -> None:
        signal.raise_signal(signal.SIGINT)
        write_json(data, path)

    monkeypatch.setattr(driver_run, "write_json", write_interrupted)

    # The process that runs the tests may ignore the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            RunDriver(
                scenario,
                duration=3600.0,
                json=tmp_path / "driver.json",
                say=lambda line: signal.raise_signal(signal.SIGINT) if "listens" in line else None,
            )
    finally:
        signal.signal(signal.SIGINT, before)

    assert json.loads((tmp_path / "driver.json").read_text())["reason"] == "stopped by the user"

"""A stand-in robot that misbehaves once its arm has moved for a while."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.benchmarks.hardware.stand_in_robot import StandInRobot, StandInSetup, read_setup
from poil_drake.systems.lcm.panda_messages import (
    HandOpening,
    PandaStatus,
    encode_hand_status,
    encode_panda_status,
)
from poil_drake.systems.statuses import RobotMode

MOVING = 0.02  # [rad/s]: an arm faster than this is moving.
BAD_FOR = 1.2  # [s]: time with some bad messages before a reflex ends the run.
BRIEFLY = 0.1  # [s]: longer than the detection of a push takes.


def start_listener(setup: StandInSetup) -> None:
    """Starts a process that records commands after the robot is killed."""
    program = Path(__file__).with_name("command_listener.py")
    listener = subprocess.Popen(
        [sys.executable, program, setup.robot_url, sys.argv[1] + ".told", str(setup.time_scale)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    listener.stdout.readline()


class FaultyRobot(StandInRobot):
    def __init__(self, setup: StandInSetup):
        super().__init__(setup)
        self.moved_at: float | None = None
        self.fault_at: float | None = None
        self.last_message = b""
        self.obeyed = np.zeros(7)
        if setup.fault == "driver_killed":
            start_listener(setup)

    def faulty(self, *names: str) -> bool:
        return self.fault_at is not None and self.setup.fault in names

    @property
    def faulty_for(self) -> float:
        return 0.0 if self.fault_at is None else self.clock() - self.fault_at

    @property
    def in_reflex(self) -> bool:
        return self.faulty("reflex") or (self.faulty("some_bad") and self.faulty_for > BAD_FOR)

    def now(self) -> float:
        if self.faulty("clock_ahead"):
            return super().now() + 1.0
        if self.faulty("clock_behind"):
            return super().now() - 1.0
        return super().now()

    def step(self, tick: int) -> None:
        super().step(tick)
        if self.moved_at is None and self.speeds[-1][1] > MOVING:
            self.moved_at = self.clock()
            print("moving", flush=True)
        due = self.moved_at is not None and self.clock() - self.moved_at >= self.setup.after
        if due and self.fault_at is None and self.setup.fault:
            self.fault_at = self.clock()
            if self.setup.fault == "driver_killed":
                print(json.dumps(self.seen()), flush=True)
                os.kill(os.getpid(), signal.SIGKILL)

    def desired_velocity(self, now: float) -> np.ndarray:
        if self.in_reflex:
            return np.zeros(7)
        if not self.faulty("packets_lost") or len(self.commanded) % 3 == 0:
            self.obeyed = super().desired_velocity(now)
        return self.obeyed

    def status(self, stamp: float) -> PandaStatus:
        status = super().status(stamp)
        briefly = self.faulty("pushed_briefly") and self.faulty_for < BRIEFLY
        if self.faulty("pushed") or briefly:
            push = np.array([0.0, 60.0, 0.0, 0.0, 0.0, 0.0, 0.0])
            status = status._replace(torque_external=status.torque_external + push)
        if self.in_reflex:
            status = status._replace(mode=RobotMode.REFLEX)
        if self.faulty("packets_lost"):
            status = status._replace(success_rate=0.3)
        return status

    def send_status(self, now: float) -> None:
        message = encode_panda_status(self.status(now), self.velocity)
        channel = self.channels.status
        if self.faulty("status_stopped"):
            return
        if self.faulty("all_malformed", "some_bad"):
            self.lcm.Publish(channel, b"\x01garbage")
        if self.faulty("all_foreign", "some_bad"):
            foreign = HandOpening(stamp=now, width=0.0)
            self.lcm.Publish(channel, encode_hand_status(foreign, False))
        if self.faulty("all_late", "some_bad"):
            late = self.status(now - 0.3)
            self.lcm.Publish(channel, encode_panda_status(late, self.velocity))
        if self.faulty("all_repeated", "some_bad"):
            self.lcm.Publish(channel, self.last_message)
        if not self.faulty("all_malformed", "all_foreign", "all_late", "all_repeated"):
            self.lcm.Publish(channel, message)
            self.last_message = message

    def send_images(self) -> None:
        stamp = self.now()
        first = next(iter(self.pictures))
        for name in self.pictures:
            message = self.picture(name, stamp)
            if name == first and self.faulty("camera_unplugged"):
                continue
            if name == first and self.faulty("camera_garbage"):
                message = b"garbage"
            if name == first and self.faulty("camera_frozen"):
                message = self.picture(name, self.fault_at or stamp)
            self.images.Publish(self.image_channel(name), message)

    def seen(self) -> dict[str, Any]:
        return {**super().seen(), "fault_at": self.fault_at, "moved_at": self.moved_at}


if __name__ == "__main__":
    FaultyRobot(read_setup(sys.argv[1])).run()

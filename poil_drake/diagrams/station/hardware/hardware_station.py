"""The real robot's station: a Franka controlled by its driver, and cameras."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, DiagramBuilder

from poil_drake.diagrams.scenario.hardware_config import ROBOT_BUS_URL, LcmImages
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import MakeCameraModels
from poil_drake.diagrams.station.cameras.capture_sources import (
    BusUrl,
    CheckHardwareCameras,
    MakeCaptureDevice,
    SendsLabels,
)
from poil_drake.diagrams.station.hardware.hardware_view import AddHardwareView
from poil_drake.diagrams.station.hardware.panda_hardware import AddPandaHardware, MailboxProblems
from poil_drake.diagrams.station.station_base import ExportOutputs, Station
from poil_drake.diagrams.station.station_models import MakeUnsimulatedPlant, PrefinalizeCallback
from poil_drake.errors import StationError
from poil_drake.perception.capture.capture_thread import AHEAD, CaptureThread, camera_problems
from poil_drake.perception.images import RgbdImage
from poil_drake.systems.cameras.captured_cameras import CapturedCameras
from poil_drake.systems.capture_timing import Worker
from poil_drake.systems.lcm.network import Clock, LcmNetwork
from poil_drake.systems.statuses import RobotMode

_IMAGES_SHARE = 7 / 8
"""Fraction of the control period after which images are captured: after `COMMAND_SHARE`."""

_REOPEN = 3.0
"""Time from a camera's failure to the next attempt to open it [s of robot time]. It is long
enough for the supervisor to stop the arm, because an attempt may block Python for a second."""

_LISTEN = 0.05
"""How long to listen for other processes that command the robot [s of robot time]."""

_LOOK = 0.01
"""Time between two checks for messages and images while waiting for them [s]."""

_REST = 1.5
"""How long to send zero velocities after braking, as a multiple of the driver's command expiry."""


class HardwareStation(Station):
    """The real robot, built by `MakeStation`.

    .. pydrake_system::

        name: HardwareStation
        input_ports:
        - panda.velocity
        - panda.velocity_time
        - hand.width
        output_ports:
        - panda.position_measured
        - panda.velocity_measured
        - panda.torque_external
        - panda.status
        - hand.width_measured
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.rgbd_image
        - <camera>.label_image
        - <camera>.image_time

    The ports are those of `SimulatedStation`, without those that only a simulation has, such as
    poses and contacts. `<camera>.label_image` exists for cameras whose source sends labels.
    See `AddPandaHardware` and `CapturedCameras` for the outputs before the first message or image.

    In a dry run, nothing is sent to the robot. Commands move a `KinematicRobot` instead, which
    starts at the real robot's posture. The measurements are then those of the `KinematicRobot`.

    Simulate the station at the pace of its clock (see `RealTimeLoop`). The scenario's models give
    the poses of the robot's base and the cameras. Meshcat shows the models, except the object; the
    robot appears in its measured posture.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        meshcat: Meshcat | None,
        cameras: bool,
        package_xmls: Sequence[str | Path],
        dry_run: bool,
        parser_preload_callback: PrefinalizeCallback | None,
        parser_prefinalize_callback: PrefinalizeCallback | None,
    ):
        super().__init__()
        builder = DiagramBuilder()
        self.scenario = scenario
        self._config = scenario.poil.hardware
        self._clock: Clock = self._config.clock()
        # Changes of the system time do not affect this clock.
        self.clock = self._config.steady_clock()
        self._plant, self._scene_graph, self.label_ids = MakeUnsimulatedPlant(
            scenario,
            package_xmls=package_xmls,
            parser_preload_callback=parser_preload_callback,
            parser_prefinalize_callback=parser_prefinalize_callback,
        )
        CheckHardwareCameras(scenario)
        self._url = BusUrl(scenario, self._config.robot_bus, ROBOT_BUS_URL)
        self._lcm = LcmNetwork(self._url, realtime_priority=self._config.realtime_priority)
        period = scenario.poil.rates.control
        # Images appear and are captured in every other period; the log is written in the others.
        offset = _IMAGES_SHARE * period
        self.tracker_timing = Worker(period=2.0 * period, offset=offset, poll_period=period)
        # Captures are as frequent, because only some images may have labels.
        self.detector_timing = replace(self.tracker_timing, poll_period=8.0 * period)
        self._robot = AddPandaHardware(
            builder=builder,
            lcm=self._lcm,
            scenario=scenario,
            dry_run=dry_run,
            clock=self._clock,
        )
        self._threads: dict[str, CaptureThread] = {}
        self.camera_models = MakeCameraModels(self._plant, scenario.cameras) if cameras else ()
        if self.camera_models:
            self._add_cameras(builder, 2.0 * period)
        if meshcat is not None:
            self._real_plant = AddHardwareView(
                builder=builder,
                scenario=scenario,
                plant=self._plant,
                scene_graph=self._scene_graph,
                meshcat=meshcat,
                dry_run=dry_run,
            )
        builder.BuildInto(self)

    def _add_cameras(self, builder: DiagramBuilder, period: float) -> None:
        reopen_period = _REOPEN / self._config.time_scale
        labels = []
        for model in self.camera_models:
            source = self._config.cameras.get(model.name, LcmImages())
            size = (model.height, model.width)
            device = MakeCaptureDevice(
                source, self.scenario, model, clock=self._clock, label_ids=self.label_ids
            )
            self._threads[model.name] = CaptureThread(
                device, name=model.name, size=size, reopen_period=reopen_period
            )
            labels.append(SendsLabels(source))
        system = builder.AddNamedSystem(
            "cameras",
            CapturedCameras(
                cameras=self.camera_models,
                sources=list(self._threads.values()),
                labels=labels,
                period=period,
                clock=self._clock,
            ),
        )
        ExportOutputs(builder, system)

    def TakeImages(self, context: Context, *, labels: bool = False) -> tuple[RgbdImage, ...]:
        """See `Station.TakeImages`.

        Waits until every camera has an image captured after this call. With `labels`, waits for an
        image with labels from each camera whose source sends labels.
        """
        start = self._clock()
        found: dict[str, RgbdImage] = {}
        deadline = time.monotonic() + self._config.ready_timeout
        while missing := [name for name in self.camera_names if name not in found]:
            self._wait(deadline, [self._image_of(name, labels=labels) for name in missing])
            for name in missing:
                image = self._threads[name].newest
                if image is None or image.stamp < start:
                    continue
                sends_labels = self.HasOutputPort(f"{name}.label_image")
                if not labels or not sends_labels or image.label is not None:
                    found[name] = image
        return tuple(found[name] for name in self.camera_names)

    def _image_of(self, name: str, *, labels: bool) -> str:
        """Returns the phrase that names a missing image in errors."""
        if labels and self._threads[name].newest is not None:
            return f"a label image of the camera '{name}', whose other images arrive"
        return f"an image of the camera '{name}'"

    def ArmPosition(self, context: Context) -> np.ndarray:
        """See `Station.ArmPosition`. Waits for a status that was sent after this call."""
        # The driver's clock may be behind.
        start = self._clock() - self._config.command_expiry
        deadline = time.monotonic() + self._config.ready_timeout
        while True:
            self.HandleMessages()
            status = self._robot.arm.newest
            if status is not None and status.stamp >= start:
                return np.array(status.position)
            self._wait(deadline, [f"the robot's status on {self._config.channels.status}"])

    def Start(self) -> None:
        """Starts the cameras' threads."""
        for thread in self._threads.values():
            thread.start()

    def WarmUp(self) -> None:
        """Waits for new statuses of the arm and the hand, and a new image of each camera.

        Also waits until the robot is in its moving mode.

        Raises:
            StationError: naming what did not arrive in time, or a channel on which another process
                sends.
        """
        start, deadline = self._clock(), time.monotonic() + self._config.ready_timeout
        while missing := self._older_than(start):
            self._wait(deadline, missing)
        senders = (self._robot.sender, self._robot.hand_sender)
        channels = [one.channel for one in senders if one is not None]
        for channel in channels:
            channel.foreign = 0
        end = time.monotonic() + _LISTEN / self._config.time_scale
        while time.monotonic() < end:
            self.HandleMessages()
            self._robot.arm.CheckOneSender()
            for channel in channels:
                channel.CheckAlone()
            time.sleep(_LOOK)

    def _older_than(self, time: float) -> list[str]:
        """Returns what has not arrived since `time` [s] or cannot be used, one phrase each.

        A status may be older than `time` by up to the driver's command expiry, because the driver's
        clock may be behind.
        """
        self.HandleMessages()
        drivers = time - self._config.command_expiry
        channels = self._config.channels
        statuses = (
            (f"the robot's status on {channels.status}", self._robot.arm.newest),
            (f"the hand's status on {channels.hand_status}", self._robot.hand.newest),
        )
        missing = [what for what, found in statuses if found is None or found.stamp < drivers]
        now = self._clock()
        for name, thread in self._threads.items():
            if thread.newest is None or thread.newest.stamp < time:
                missing.append(f"an image of the camera '{name}'")
            elif thread.newest.stamp > now + AHEAD:
                missing.append(f"an image of the camera '{name}' that is not stamped in the future")
        status = self._robot.arm.newest
        if status is not None and status.mode is not RobotMode.MOVE:
            missing.append(f"a robot in its moving mode (it is in '{status.mode.name.lower()}')")
        return missing

    def Close(self) -> None:
        """Brings the robot to rest, and ends the cameras' threads."""
        try:
            self.Rest()
        finally:
            for thread in self._threads.values():
                thread.close()
            self._lcm.Close()

    def Rest(self) -> None:
        """If the arm was commanded, brakes it and sends zeros for longer than `command_expiry`."""
        sender = self._robot.sender
        if sender is not None and sender.commanding:
            sender.SendRest(_REST * self._config.command_expiry / self._config.time_scale)

    def HandleMessages(self) -> None:
        """See `Station.HandleMessages`."""
        self._lcm.HandleSubscriptions(0)

    def Problems(self) -> tuple[str, ...]:
        """See `Station.Problems`."""
        channels, expiry = self._config.channels, self._config.command_expiry
        found = [
            *MailboxProblems(self._robot.arm, channels.status, expiry),
            *MailboxProblems(self._robot.hand, channels.hand_status, expiry),
        ]
        now, oldest = self._clock(), self.scenario.poil.safety.image_age_limit
        for name, problems in camera_problems(self._threads, now=now, oldest=oldest).items():
            found += [f"camera '{name}': {problem}" for problem in problems]
        return tuple(found)

    def _wait(self, deadline: float, missing: Sequence[str]) -> None:
        if time.monotonic() > deadline:
            raise self._missing(missing)
        time.sleep(_LOOK)

    def _missing(self, missing: Sequence[str]) -> StationError:
        problems = "; ".join(self.Problems())
        problems = f" ({problems})" if problems else ""
        return StationError(
            f"The station waits up to {self._config.ready_timeout:g} s. This is still missing: "
            f"{', '.join(missing)}{problems}. The robot's network is {self._url}.",
            remedy="Start the Franka driver (or poil driver) with the same scenario, and check the "
            "networks, channels and cameras in poil.hardware.",
        )

"""A station that plays back the robot, the cameras and the perception of a recorded run."""

from collections.abc import Collection, Sequence

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from poil_drake.diagrams.replay.contents import IsSparse
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.diagrams.station.cameras.cameras import CameraDelay, MakeCameraModels
from poil_drake.diagrams.station.station_base import (
    COMMANDS,
    MEASUREMENTS,
    ExportOutputs,
    ExportPorts,
    Station,
)
from poil_drake.diagrams.station.station_models import MakeUnsimulatedPlant
from poil_drake.errors import InvalidValueError, RunLogError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.faults.extrinsics import miscalibrated
from poil_drake.perception.images import CameraModel
from poil_drake.recording.demonstration.stored_images import StoredImages
from poil_drake.recording.mcap.timestamps import to_seconds
from poil_drake.recording.run_log.layout import (
    DETECTOR_TIMES_TOPIC,
    DRY_RUN,
    HAND_STATUS_TOPIC,
    ROBOT_STATUS_TOPIC,
    SIMULATED,
    STATION_KEY,
    TRACKER_STATUS_TOPIC,
    TRACKER_TIMES_TOPIC,
)
from poil_drake.recording.run_log.recorded_run import REMEDY, LoggedTrack, RecordedRun, Series
from poil_drake.systems.cameras.recorded_cameras import RecordedCamera, RecordedCameras
from poil_drake.systems.capture_timing import RecordedTiming
from poil_drake.systems.panda.recorded_robot import (
    HAND,
    JOINTS,
    STATUS,
    RecordedClock,
    RecordedRobot,
)
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.recorded_tracker import RecordedTrack, RecordedTracker

_ROUNDING = 1e-6

_DECIMALS = 9
"""Decimals to which offsets of captures [control periods] are rounded: logged times are inexact."""


class ReplayStation(Station):
    """Plays back the robot and the cameras of a recorded run.

    .. pydrake_system::

        name: ReplayStation
        input_ports:
        - panda.velocity
        - panda.velocity_time
        - hand.width
        output_ports:
        - panda.position_measured
        - panda.velocity_measured
        - panda.torque_external
        - panda.status
        - panda.position_commanded
        - hand.width_measured
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.rgbd_image
        - <camera>.label_image
        - <camera>.image_time

    The ports are those of `HardwareStation`, and `panda.position_commanded` (7,) [rad], the posture
    that was commanded in the run. The station ignores its inputs. Its outputs have the values in
    the log at the time of the context (see `RecordedRobot` and `RecordedCameras`). Before the first
    sample, vectors are NaN and images are empty. `<camera>.label_image` exists for cameras that
    have label images in the log. As in `HardwareStation`, the scenario's models give the poses of
    the robot's base and the cameras.
    """

    clock: RecordedClock | None

    def __init__(self, scenario: Scenario, run: RecordedRun, *, repeat_tracks: bool = False):
        """Constructs the station.

        Args:
            scenario: The scenario of the replay, which may differ from the run's.
            run: The recorded run.
            repeat_tracks: Whether to repeat the run's tracks instead of tracking its images.

        Raises:
            PoilError: if the scenario's models or the recorded times are inconsistent.
        """
        super().__init__()
        self.scenario, self._run = scenario, run
        self._kind = run.metadata.get(STATION_KEY, SIMULATED)
        status = run.numbers[ROBOT_STATUS_TOPIC]
        self.clock = RecordedClock() if np.isfinite(status.values[:, 3]).any() else None
        self._repeat_tracks = repeat_tracks
        self.tracker_timing, self.detector_timing = RecordedTimings(
            run, period=scenario.poil.rates.control
        )
        builder = DiagramBuilder()
        self._plant, self._scene_graph, made = MakeUnsimulatedPlant(scenario)
        self.label_ids = run.label_ids or made
        self._add_robot(builder)
        if scenario.poil.tracker != GROUND_TRUTH and scenario.cameras:
            self.camera_models = MakeCameraModels(self._plant, scenario.cameras)
            if self._kind == SIMULATED:
                self.camera_models = miscalibrated(self.camera_models, scenario.poil.faults)
            self._add_cameras(builder)
        builder.BuildInto(self)

    def _add_robot(self, builder: DiagramBuilder) -> None:
        run = self._run
        hand, status = run.numbers[HAND_STATUS_TOPIC], run.numbers[ROBOT_STATUS_TOPIC]
        width = Series(hand.times, hand.values[:, 1:])
        joints = run.joints
        leading: Collection[str] = (JOINTS, HAND, STATUS)
        if self._kind == DRY_RUN:
            # Arm and hand were a `KinematicRobot`, which moves in discrete updates.
            leading = (STATUS,)
        if self._kind == DRY_RUN or IsSparse(run, self.scenario):
            # The first measurements take effect in the period in which they arrive.
            joints, width = _known_early(joints), _known_early(width)
        robot = builder.AddNamedSystem(
            "robot",
            RecordedRobot(
                joints=joints,
                hand=width,
                status=status,
                postures=run.postures,
                period=self.scenario.poil.rates.control,
                clock=self.clock,
                leading=leading,
            ),
        )
        arm_ports = [*COMMANDS, *MEASUREMENTS, "status", "position_commanded"]
        ExportPorts(builder, robot, arm_ports, self.scenario.poil.robot)
        ExportPorts(builder, robot, ["width", "width_measured"], "hand")

    def _add_cameras(self, builder: DiagramBuilder) -> None:
        delay = CameraDelay(self.scenario.cameras)
        system = builder.AddNamedSystem(
            "cameras",
            RecordedCameras(cameras=[self._camera(model, delay) for model in self.camera_models]),
        )
        ExportOutputs(builder, system)

    def _camera(self, model: CameraModel, delay: float) -> RecordedCamera:
        images = self._run.images.get(model.name, [])
        stamps = [to_seconds(image.color.stamp) for image in images]
        simulated = self._kind == SIMULATED
        if simulated:
            shown_from = [stamp + delay for stamp in stamps]
        else:
            shown_from = [self._shown_at(image) for image in images]
        times = self._run.camera_times.get(model.name, Series.of([], 1))
        return RecordedCamera(
            name=model.name,
            shown_from=shown_from,
            stamps=stamps,
            read=self._run.image_reader(model),
            labels=any(image.label is not None for image in images),
            times=None if simulated and delay == 0.0 else times,
        )

    def _shown_at(self, image: StoredImages) -> float:
        """Returns the start [s] of the control period in which perception used an image."""
        uses = [
            self._run.numbers[topic].at(image.time)[0]
            for topic in (TRACKER_TIMES_TOPIC, DETECTOR_TIMES_TOPIC)
        ]
        use = image.time if np.isnan(uses).all() else np.nanmax(uses)
        period = self.scenario.poil.rates.control
        return float(np.floor(use / period + _ROUNDING) * period)

    def MakeImagelessTracker(self, plan: ExecutionPlan) -> RecordedTracker | None:
        """Returns a tracker that repeats the run's tracks, or None if the station repeats none."""
        if not self._repeat_tracks:
            return None
        return RecordedTracker(
            tracks=RecordedTracks(self._run),
            num_points=len(plan.target_points),
            period=self.scenario.poil.rates.control,
        )


def _known_early(series: Series) -> Series:
    """Returns a copy of a series in which its first finite sample holds from an earlier time on.

    The earlier time is that of the sample before it or, if there is none, minus infinity.
    """
    known = np.isfinite(series.values).all(axis=1)
    if not known.any():
        return series
    first = int(np.argmax(known))
    values = series.values.copy()
    if first > 0:
        values[first - 1] = values[first]
        return Series(series.times, values)
    return Series(np.insert(series.times, 0, -np.inf), np.insert(values, 0, values[0], axis=0))


def RecordedTimings(run: RecordedRun, *, period: float) -> tuple[RecordedTiming, RecordedTiming]:
    """Returns the capture and release times of the tracker and the detector in a recorded run.

    Args:
        run: The run.
        period: The control period [s].

    Raises:
        RunLogError: if a result was released before its images were captured.
    """
    captured = [_captured(run, topic) for topic in (TRACKER_TIMES_TOPIC, DETECTOR_TIMES_TOPIC)]
    offset = _offset(captured[0] or captured[1], period)
    return (
        _timing(run, TRACKER_TIMES_TOPIC, captured[0], period, offset),
        _timing(run, DETECTOR_TIMES_TOPIC, captured[1], period, offset),
    )


def _captured(run: RecordedRun, topic: str) -> list[float]:
    times = run.numbers[topic].values[:, 0]
    return np.unique(times[np.isfinite(times)]).tolist()


def _offset(captured: Sequence[float], period: float) -> float:
    """Returns the most frequent time [s] from the start of a control period to a capture in it."""
    if not captured:
        return 0.0
    shares = np.round(np.array(captured) / period % 1.0, _DECIMALS) % 1.0
    values, counts = np.unique(shares, return_counts=True)
    return float(values[np.argmax(counts)] * period)


def _timing(
    run: RecordedRun, topic: str, captured: Sequence[float], period: float, offset: float
) -> RecordedTiming:
    _, released, of = run.numbers[topic].values[:, :3].T
    known = np.isfinite(released) & np.isfinite(of)
    releases = sorted(set(zip(released[known].tolist(), of[known].tolist(), strict=True)))
    try:
        return RecordedTiming(captured=captured, released=releases, period=period, offset=offset)
    except InvalidValueError as error:
        raise RunLogError(f"{run.path}, topic {topic}: {error.problem}", remedy=REMEDY) from error


def RecordedTracks(run: RecordedRun) -> tuple[RecordedTrack, ...]:
    """Returns the tracks that a recorded run released, in order of release."""
    times, statuses = run.numbers[TRACKER_TIMES_TOPIC], run.numbers[TRACKER_STATUS_TOPIC]
    found = []
    for logged in run.tracks:
        _, released, captured, number = times.at(logged.time).tolist()
        if np.isfinite(released):
            found.append(
                RecordedTrack(
                    captured=captured,
                    released=released,
                    points=logged.track,
                    status=_status(logged, number, statuses),
                )
            )
    return tuple(sorted(found, key=lambda track: track.released))


def _status(logged: LoggedTrack, number: float, statuses: Series) -> TrackerStatus:
    """Returns the tracker's status for a track, inferred from the track if none was logged.

    Args:
        logged: The track.
        number: The status logged with the track's times; NaN in logs of older versions.
        statuses: The periodically logged statuses. The first one after the track is used if
            `number` is NaN.
    """
    later = int(np.searchsorted(statuses.times, logged.time))
    next_number = statuses.values[later, 0] if later < len(statuses) else np.nan
    for found in (number, next_number):
        if found in set(TrackerStatus):
            return TrackerStatus(int(found))
    seen = bool(np.any(logged.track.confidence > 0.0))
    return TrackerStatus.TRACKING if seen else TrackerStatus.LOST

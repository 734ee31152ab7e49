"""The connections of the closed loop, as pairs of "<system>.<port>".

"robot.<port>" stands for the station's port "<robot's name>.<port>".
"""

from collections.abc import Mapping
from typing import Any

from pydrake.systems.framework import DiagramBuilder

LOOP_WIRES = [
    # From                                   to
    ("tracker.tracked_points", "propagator.tracked_points"),
    ("robot.position_measured", "propagator.position_measured"),
    ("sequencer.holding", "propagator.holding"),
    ("propagator.points", "controller.points"),
    ("propagator.confidence", "controller.confidence"),
    ("propagator.gripper_pose", "controller.gripper_pose"),
    ("controller.spatial_velocity", "motion.field_velocity"),
    ("sequencer.phase", "motion.phase"),
    ("sequencer.phase_start", "motion.phase_start"),
    ("robot.position_measured", "motion.position_measured"),
    ("propagator.gripper_pose", "motion.gripper_pose"),
    ("inverse_kinematics.velocity", "motion.ik_velocity"),
    ("motion.spatial_velocity", "inverse_kinematics.spatial_velocity"),
    ("robot.position_measured", "inverse_kinematics.position_measured"),
    ("motion.velocity", "supervisor.velocity"),
    ("inverse_kinematics.command_time", "supervisor.velocity_time"),
    ("robot.position_measured", "supervisor.position_measured"),
    ("robot.velocity_measured", "supervisor.velocity_measured"),
    ("robot.torque_external", "supervisor.torque_external"),
    ("robot.status", "supervisor.status"),
    ("stop_requests.stop", "supervisor.stop"),
    ("supervisor.velocity", "robot.velocity"),
    ("supervisor.velocity_time", "robot.velocity_time"),
    ("tracker.status", "sequencer.tracker_status"),
    ("controller.status", "sequencer.controller_status"),
    ("controller.tau", "sequencer.tau"),
    ("controller.mean_error", "sequencer.mean_error"),
    ("controller.goal_error", "sequencer.goal_error"),
    ("motion.motion_done", "sequencer.motion_done"),
    ("inverse_kinematics.status", "sequencer.ik_status"),
    ("station.hand.width_measured", "sequencer.width_measured"),
    ("supervisor.fault", "sequencer.safety_fault"),
    ("sequencer.width", "station.hand.width"),
]

TRACKER_WIRES = [
    # From                         to the tracker's port, if it has it
    ("station.body_poses", "body_poses"),
    ("propagator.object_motion", "object_motion"),
]

OPTIONAL_WIRES = [
    # From                         to, if the loop has both systems
    ("detector.masks", "tracker.masks"),
    ("sequencer.detect_request", "detector.request"),
    ("robot.position_measured", "detector.position_measured"),
    ("station.hand.width_measured", "detector.width_measured"),
    ("tracker.tracked_points", "visualizer.tracked_points"),
    ("propagator.points", "visualizer.points"),
    ("propagator.confidence", "visualizer.confidence"),
    ("propagator.gripper_pose", "visualizer.gripper_pose"),
    ("controller.target_points", "visualizer.target_points"),
    ("controller.mean_error", "visualizer.mean_error"),
    ("motion.spatial_velocity", "visualizer.spatial_velocity"),
    ("sequencer.phase", "visualizer.phase"),
    ("tracker.tracked_points", "logger.tracked_points"),
    ("tracker.status", "logger.tracker.status"),
    ("tracker.times", "logger.tracker.times"),
    ("propagator.age", "logger.tracker.age"),
    ("propagator.points", "logger.points"),
    ("propagator.confidence", "logger.confidence"),
    ("propagator.gripper_pose", "logger.gripper_pose"),
    ("controller.target_points", "logger.target_points"),
    ("controller.status", "logger.controller.status"),
    ("controller.tau", "logger.controller.tau"),
    ("controller.potential", "logger.controller.potential"),
    ("controller.mean_error", "logger.controller.mean_error"),
    ("motion.spatial_velocity", "logger.spatial_velocity"),
    ("supervisor.velocity", "logger.panda.velocity"),
    ("supervisor.position", "logger.panda.position_commanded"),
    ("stop_requests.stop", "logger.stop"),
    ("supervisor.updated_at", "logger.clock"),
    ("supervisor.fault", "logger.supervisor.fault"),
    ("supervisor.scale", "logger.supervisor.scale"),
    ("inverse_kinematics.status", "logger.ik.status"),
    ("inverse_kinematics.scale", "logger.ik.scale"),
    ("controller.goal_error", "logger.controller.goal_error"),
    ("sequencer.phase", "logger.phase"),
    ("sequencer.fault", "logger.fault"),
    ("sequencer.fault", "logger.skill.fault"),
    ("sequencer.detect_request", "logger.skill.detect_request"),
    ("sequencer.holding", "logger.skill.holding"),
    ("sequencer.width", "logger.hand.width_commanded"),
    ("station.hand.width_measured", "logger.hand.width_measured"),
    ("robot.position_measured", "logger.panda.position_measured"),
    ("robot.velocity_measured", "logger.panda.velocity_measured"),
    ("robot.torque_external", "logger.panda.torque_external"),
    ("robot.status", "logger.panda.status"),
    ("detector.frame", "logger.detector.frame"),
    ("detector.status", "logger.detector.status"),
    ("detector.times", "logger.detector.times"),
    ("disturbances.applied_spatial_force", "station.applied_spatial_force"),
    ("disturbances.applied_spatial_force", "logger.applied_spatial_force"),
    ("tracker.frame", "snapshots.frame"),
    ("tracker.tracked_points", "snapshots.tracked_points"),
]


def ConnectByName(builder: DiagramBuilder, parts: Mapping[str, Any]) -> None:
    """Connects the loop's systems as listed in this file, except for systems that are absent."""
    present = {"robot", *parts}
    wires = list(LOOP_WIRES)
    wires += [wire for wire in OPTIONAL_WIRES if {end.split(".")[0] for end in wire} <= present]
    station = parts["station"]
    if station.HasOutputPort(f"{station.scenario.poil.robot}.position_commanded"):
        wires.append(("robot.position_commanded", "supervisor.position_commanded"))
    tracker = parts["tracker"]
    wires += [
        (source, f"tracker.{port}") for source, port in TRACKER_WIRES if tracker.HasInputPort(port)
    ]
    cameras = station.camera_names
    for camera in cameras:
        time = f"{camera}.image_time"
        if parts["supervisor"].HasInputPort(time):
            wires.append((f"station.{time}", f"supervisor.{time}"))
        if "logger" in parts:
            wires.append((f"station.{time}", f"logger.cameras.{time}"))
        for image in ("rgb_image", "depth_image", "rgbd_image", "label_image", "image_time"):
            port = f"{camera}.{image}"
            for part in ("tracker", "detector"):
                if part in parts and parts[part].HasInputPort(port) and station.HasOutputPort(port):
                    wires.append((f"station.{port}", f"{part}.{port}"))
    seen = [camera for camera in cameras if tracker.HasInputPort(f"{camera}.rgb_image")]
    if seen:
        wires.append((f"station.{seen[0]}.image_time", "propagator.image_time"))
    if {"detector", "logger"} <= present:
        wires.append(("tracker.frame", "logger.frame"))

    def split(end: str) -> tuple[Any, str]:
        part, port = end.split(".", 1)
        if part == "robot":
            return station, f"{station.scenario.poil.robot}.{port}"
        return parts[part], port

    for source, target in wires:
        (output_system, output), (input_system, input_) = split(source), split(target)
        builder.Connect(output_system.GetOutputPort(output), input_system.GetInputPort(input_))

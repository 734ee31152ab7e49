"""Recorded runs of the closed loop for replays, and logs with changes."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from short_skill import short_plan

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.run.open_run_log import OpenRunLog
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.run_log.layout import JOINT_COMMANDS_TOPIC
from poil_drake.recording.run_log.writer import RunLogConfig, RunLogWriter
from poil_drake.robots.panda import ARM_JOINTS
from poil_drake.systems.skill.stop_requests import StopSwitch


def moving_plan() -> ExecutionPlan:
    """Returns the short plan with an approach that turns the wrist by 0.2 rad in a second."""
    plan = short_plan()
    times = np.linspace(0.0, 1.0, 33)
    turn = np.eye(7)[6]
    way, rate = 0.1 * (1.0 - np.cos(np.pi * times)), 0.1 * np.pi * np.sin(np.pi * times)
    start = plan.approach.positions[0]
    approach = type(plan.approach)(times, start + way[:, None] * turn, rate[:, None] * turn)
    end = approach.positions[-1]
    descent = type(plan.approach)([0.0, 0.125], [end, end], np.zeros((2, 7)))
    return dataclasses.replace(plan, approach=approach, descent=descent)


def record(
    path: Path,
    scenario: Scenario,
    plan: ExecutionPlan,
    duration: float,
    *,
    config: RunLogConfig | None = None,
    stop_at: float | None = None,
) -> Path:
    """Runs the simulated loop for a duration [s] and returns its log."""
    switch = StopSwitch()
    with (
        OpenRunLog(path, plan=plan, scenario=scenario, config=config) as log,
        MakeClosedLoop(scenario, plan, log=log, stop_switch=switch) as loop,
    ):
        simulator = Simulator(loop.diagram)
        ApplySimulatorConfig(scenario.simulator_config, simulator)
        simulator.set_target_realtime_rate(0.0)
        if stop_at is not None:
            simulator.AdvanceTo(stop_at)
            switch.request()
        simulator.AdvanceTo(duration)
    return path


def write_samples(log: RunLogWriter, times: Sequence[float] = (0.0,)) -> None:
    """Writes the topics that every replay needs, for an arm at rest."""
    still = np.zeros(7)
    for time in times:
        log.write_joint_states(ARM_JOINTS, time=time, position=still, velocity=still)
        log.write_joint_states(
            ARM_JOINTS, time=time, position=still, velocity=still, topic=JOINT_COMMANDS_TOPIC
        )


def beginning(source: Path, target: Path, duration: float) -> Path:
    """Copies the first seconds (`duration` [s]) of a log."""

    def keep(topic: str, message: Message) -> bytes | None:
        return message.data if message.log_time <= 1e9 * duration else None

    return rewritten(source, target, message=keep)


def rewritten(
    source: Path,
    target: Path,
    *,
    message: Callable[[str, Message], bytes | None] = lambda topic, message: message.data,
    attachment: Callable[[Attachment], bool] = lambda attachment: True,
    metadata: Callable[[dict[str, str]], dict[str, str]] = lambda values: values,
) -> Path:
    """Copies a log with changes.

    Args:
        source: The log.
        target: The copy.
        message: Returns the new data of a message on a topic; None drops the message.
        attachment: Whether to keep an attachment.
        metadata: Returns the new metadata.
    """
    schemas: dict[int, int] = {}
    channels: dict[int, tuple[int, str]] = {}
    with source.open("rb") as read, target.open("wb") as written:
        writer = Writer(written)
        writer.start()
        for record in StreamReader(read).records:
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            elif isinstance(record, Channel) and record.id not in channels:
                number = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id]
                )
                channels[record.id] = (number, record.topic)
            elif isinstance(record, Message):
                number, topic = channels[record.channel_id]
                data = message(topic, record)
                if data is not None:
                    writer.add_message(number, record.log_time, data, record.publish_time)
            elif isinstance(record, Attachment) and attachment(record):
                writer.add_attachment(0, 0, record.name, record.media_type, record.data)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, metadata(dict(record.metadata)))
        writer.finish()
    return target

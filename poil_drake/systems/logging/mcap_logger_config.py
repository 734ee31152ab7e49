"""How the closed loop is logged."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class McapLoggerConfig:
    """What is logged, and when.

    Attributes:
        period: Time between samples of signals [s].
        robot_period: Time between samples of the robot's signals [s], from which a replay makes the
            others again, if they are as close as the control period; None: as `period`. So soon
            frames, tracks, phases and requests to stop are noticed, too.
        robot_offset: Time of the first of them [s]: where it is the plant's time step, they show
            what the controller saw at the beginning of its period.
        robot_topics: The status topics that are logged with the robot's signals.
        color: Whether the cameras' colour images are logged.
        depth: Whether their depth images are; they are most of a log's size.
        gripper_frame: What the gripper's frame is called in the log.
    """

    period: float = 1 / 32
    robot_period: float | None = None
    robot_offset: float = 0.0
    robot_topics: tuple[str, ...] = ("hand",)
    color: bool = True
    depth: bool = True
    gripper_frame: str = "gripper"

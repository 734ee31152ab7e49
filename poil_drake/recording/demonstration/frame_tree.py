"""Frames, and the recorded transforms between them."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import interpolate_poses, inverse
from poil_drake.recording.demonstration.layout import STATIC_TRANSFORM_TOPIC
from poil_drake.recording.mcap.message_decoders import decode_transform, frame_name
from poil_drake.recording.mcap.timestamps import (
    NANOSECONDS_PER_SECOND,
    get_timestamp,
    to_seconds,
)

_LARGEST_GAP = NANOSECONDS_PER_SECOND
"""Longest time between two transforms, [ns], across which a moving frame is interpolated."""

_SAME_POSE = 1e-6
"""Largest difference between entries of transforms that count as equal."""

_ALWAYS = (-(2**62), 2**62)


@dataclass
class _Link:
    """The recorded poses of a frame in its parent, in the order of the file."""

    parent: str
    stamps: list[int] = field(default_factory=list)
    log_times: list[int] = field(default_factory=list)
    poses: list[np.ndarray] = field(default_factory=list)


class FrameTree:
    """Frames and the recorded transforms between them.

    A frame whose transforms are static or all equal has that pose at all times. Other frames move:
    between two transforms, they turn and move at constant speed. If all transforms of a frame carry
    one stamp, e.g. 0 because it is not filled in, they count from the times of logging.
    """

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._tracks: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._use_log_times = False

    def add(self, transform: FrameTransform, *, log_time: int, static: bool) -> None:
        """Adds the pose of a child frame in its parent.

        If the child had another parent, its poses in that parent are discarded.

        Args:
            transform: The pose, and its time or 0 if that is not filled in.
            log_time: The time when it was logged [ns].
            static: Whether the pose replaces all others of the child, and holds at all times.

        Raises:
            InvalidValueError: if the pose or the stamp is invalid.
        """
        parent, child = map(frame_name, (transform.parent_frame_id, transform.child_frame_id))
        X_PC, stamp = decode_transform(transform), get_timestamp(transform, default=0)
        link = self._links.get(child)
        if link is None or link.parent != parent or static:
            link = self._links[child] = _Link(parent)
        link.stamps.append(stamp)
        link.log_times.append(log_time)
        link.poses.append(X_PC)
        self._tracks.pop(child, None)

    def use_log_times(self) -> None:
        """Uses the times at which the transforms were logged instead of their stamps."""
        self._use_log_times = True
        self._tracks.clear()

    def __contains__(self, frame: str) -> bool:
        return frame in self._links or any(link.parent == frame for link in self._links.values())

    def root(self, frame: str) -> str:
        """Returns the root of the tree that holds `frame`, which may be `frame` itself."""
        return self._chain(frame)[-1]

    def listing(self) -> str:
        """Returns each root and the frames below it, for error messages."""
        trees: dict[str, list[str]] = {}
        for child in sorted(self._links):
            trees.setdefault(self.root(child), []).append(child)
        return "; ".join(f"{root} > {', '.join(below)}" for root, below in trees.items()) or "none"

    def connected(self, *, base: str, frame: str) -> bool:
        """Returns whether transforms connect the two frames; a frame without a name has no pose."""
        return bool(base and frame) and self.root(base) == self.root(frame)

    def pose(self, *, base: str, frame: str, stamp: int) -> np.ndarray:
        """Returns the (4, 4) pose of `frame` in `base` [m] at `stamp` [ns].

        A moving frame keeps its first pose before `span`, and its last pose after it.

        Raises:
            InvalidValueError: if the frames are not connected, or if a frame moves and the
                transforms around `stamp` are too far apart.
        """
        if not self.connected(base=base, frame=frame):
            raise InvalidValueError(
                f"no transform connects frame '{base}' with frame '{frame}'.",
                remedy="Record a transform between them.",
            )
        to_base, to_frame = self._paths(base, frame)
        pose: np.ndarray = inverse(self._pose(to_base, stamp)) @ self._pose(to_frame, stamp)
        return pose

    def span(self, *, base: str, frame: str) -> tuple[int, int]:
        """Returns the first and the last time [ns] at which the pose of `frame` in `base` is known.

        The span of frames that do not move is unlimited.
        """
        moving = [
            stamps
            for path in self._paths(base, frame)
            for child in path
            if len(stamps := self._track(child)[0]) > 1
        ]
        first = max((int(stamps[0]) for stamps in moving), default=_ALWAYS[0])
        return first, min((int(stamps[-1]) for stamps in moving), default=_ALWAYS[1])

    def _chain(self, frame: str) -> list[str]:
        """Returns `frame` and its ancestors, each once even if the transforms form a cycle."""
        chain = [frame]
        while (link := self._links.get(chain[-1])) is not None and link.parent not in chain:
            chain.append(link.parent)
        return chain

    def _paths(self, base: str, frame: str) -> tuple[list[str], list[str]]:
        """Returns the frames from `base` and from `frame` up to below their common ancestor."""
        bases, frames = self._chain(base), self._chain(frame)
        return [f for f in bases if f not in frames], [f for f in frames if f not in bases]

    def _pose(self, path: Sequence[str], stamp: int) -> np.ndarray:
        """Returns the (4, 4) pose of the first frame of a path in the parent of the last [m]."""
        X = np.eye(4)
        for child in path:
            X = self._pose_in_parent(child, stamp) @ X
        return X

    def _pose_in_parent(self, child: str, stamp: int) -> np.ndarray:
        stamps, poses = self._track(child)
        after = int(np.searchsorted(stamps, stamp))
        if after == 0 or after == len(stamps) or stamps[after] == stamp:
            end: np.ndarray = poses[min(after, len(stamps) - 1)]
            return end
        before, gap = after - 1, int(stamps[after] - stamps[after - 1])
        if gap > _LARGEST_GAP:
            raise InvalidValueError(
                f"frame '{child}' moves, but has no transform between "
                f"{to_seconds(int(stamps[before])):.3f} s and {to_seconds(int(stamps[after])):.3f} "
                f"s, a gap of {to_seconds(gap):.2f} s, in which an image was taken at "
                f"{to_seconds(stamp):.3f} s.",
                remedy="Record the transforms of moving frames at least once a second, on the "
                f"clock of the images, and those of frames at rest on {STATIC_TRANSFORM_TOPIC}.",
            )
        return interpolate_poses(poses[before], poses[after], (stamp - stamps[before]) / gap)

    def _track(self, child: str) -> tuple[np.ndarray, np.ndarray]:
        """Returns the (N,) sorted stamps [ns] and (N, 4, 4) poses of a frame; N is 1 at rest."""
        if child not in self._tracks:
            link = self._links[child]
            unstamped = len(set(link.stamps)) == 1 or self._use_log_times
            stamps = np.array(link.log_times if unstamped else link.stamps, dtype=np.int64)
            stamps, first = np.unique(stamps, return_index=True)
            poses = np.array(link.poses)
            if np.abs(poses - poses[0]).max() <= _SAME_POSE:
                first = first[:1]
            self._tracks[child] = stamps[: len(first)], poses[first]
        return self._tracks[child]

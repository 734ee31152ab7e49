"""Poses of frames from a recording's transforms, which may form chains and vary over time."""

import bisect
from operator import itemgetter

import numpy as np

_STAMP = itemgetter(0)


class FrameTree:
    """Frames and the recorded transforms between them.

    A transform holds from its stamp until the stamp of the next transform between the same frames.
    The first one also holds before its stamp, so that a static transform may carry any stamp.
    """

    def __init__(self) -> None:
        self._parent: dict[str, str] = {}
        self._poses: dict[str, list[tuple[int, np.ndarray]]] = {}

    def add(self, *, parent: str, child: str, stamp: int, X_PC: np.ndarray) -> None:
        """Adds the (4, 4) pose of `child` in `parent` [m] at `stamp` [ns].

        If `child` had another parent, its poses in that parent are discarded.
        """
        if self._parent.get(child) != parent:
            self._parent[child], self._poses[child] = parent, []
        bisect.insort(self._poses[child], (stamp, X_PC), key=_STAMP)

    def __contains__(self, frame: str) -> bool:
        return frame in self._parent or frame in self._parent.values()

    def root(self, frame: str) -> str:
        """Returns the root of the tree that holds `frame`, which may be `frame` itself."""
        return self._chain(frame)[-1]

    def pose(self, *, base: str, frame: str, stamp: int) -> np.ndarray | None:
        """Returns the (4, 4) pose of `frame` in `base` [m] at `stamp` [ns]; None if unconnected."""
        if self.root(base) != self.root(frame):
            return None
        X_RB = self._pose_in_root(base, stamp)
        return np.linalg.solve(X_RB, self._pose_in_root(frame, stamp))

    def _chain(self, frame: str) -> list[str]:
        """Returns `frame` and its ancestors, each once even if the transforms form a cycle."""
        chain = [frame]
        while (parent := self._parent.get(chain[-1])) is not None and parent not in chain:
            chain.append(parent)
        return chain

    def _pose_in_root(self, frame: str, stamp: int) -> np.ndarray:
        X_RF = np.eye(4)
        for child in self._chain(frame)[:-1]:
            poses = self._poses[child]
            at = bisect.bisect_right(poses, stamp, key=_STAMP) - 1
            X_RF = poses[max(at, 0)][1] @ X_RF
        return X_RF

"""The frames in a ROS bag, and whether they connect the cameras with the world."""

from collections.abc import Mapping

from poil_drake.errors import DemonstrationError


class FrameLinks:
    """Which frame is the parent of which, without poses."""

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}

    def add(self, *, parent: str, child: str) -> None:
        """Adds a transform."""
        self._parents[child] = parent

    def require_connected(self, cameras: Mapping[str, str], *, world: str, source: str) -> None:
        """Checks that transforms give the pose of each camera in the world.

        Args:
            cameras: The optical frame of each camera, by its name.
            world: The world frame.
            source: The file, for the error.

        Raises:
            DemonstrationError: if a camera's frame is not connected with the world, or is another
                camera's as well.
        """
        users: dict[str, str] = {}
        for name, frame in cameras.items():
            if self._root(frame) != self._root(world):
                raise DemonstrationError(
                    f"{source}: no transform connects frame '{world}' with frame '{frame}' of "
                    f"camera '{name}'. The frames in the bag: {self._listing()}.",
                    remedy="Name the frame that is the scenario's world, e.g. --world panda_link0; "
                    "record /tf and /tf_static; or take the poses from a scenario's cameras with "
                    "--scenario.",
                )
            if frame in users:
                raise DemonstrationError(
                    f"{source}: the cameras '{users[frame]}' and '{name}' are in the same frame, "
                    f"'{frame}', so their poses cannot be told apart.",
                    remedy="Give the drivers different names of cameras and record again, or take "
                    "the poses from a scenario's cameras with --scenario.",
                )
            users[frame] = name

    def _root(self, frame: str) -> str:
        """Returns the last ancestor of a frame, also if the transforms form a circle."""
        seen = {frame}
        while (parent := self._parents.get(frame, frame)) not in seen:
            seen.add(parent)
            frame = parent
        return frame

    def _listing(self) -> str:
        """Returns each root with the frames below it."""
        trees: dict[str, list[str]] = {}
        for child in sorted(self._parents):
            trees.setdefault(self._root(child), []).append(child)
        return "; ".join(f"{root} > {', '.join(below)}" for root, below in trees.items()) or "none"

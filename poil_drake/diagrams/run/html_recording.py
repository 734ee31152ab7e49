"""The live Meshcat page, and the recording of a run as one HTML file."""

import html
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams

from poil_drake.errors import StationError

CAMERA_POSITION = (1.60, -0.10, 0.82)
"""Initial position of the page's camera [m, world]: in front of the robot and a little above, so
that it sees the object, the fixture and the arm."""

_CAMERA_TARGET = (0.30, 0.06, 0.34)
"""The point that the camera looks at [m, world]."""


def MakeMeshcat(*, host: str = "localhost", port: int | None = None) -> Meshcat:
    """Starts Meshcat's server. `web_url()` of the result is the page to open.

    Args:
        host: Address to listen on. The default is reachable from this machine only; "*" listens on
            every network interface, for a viewer on another machine.
        port: The TCP port. None uses the first free one from 7000 to 7999.

    Raises:
        StationError: if Meshcat cannot listen on the port, e.g. because it is taken.
    """
    try:
        meshcat = Meshcat(MeshcatParams(host=host, port=port, show_stats_plot=False))
    except RuntimeError as error:
        raise StationError(
            f"Meshcat cannot listen on {host}:{port or '7000-7999'} ({error}).",
            remedy="Use another host or port, or end the program that uses this port.",
        ) from error
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetCameraPose(np.array(CAMERA_POSITION), np.array(_CAMERA_TARGET))
    return meshcat


@contextmanager
def HtmlRecording(
    meshcat: Meshcat,
    path: str | Path,
    *,
    title: str = "poil_drake",
    frames_per_second: float = 32.0,
) -> Iterator[Path]:
    """Records Meshcat in a `with` block, and writes one HTML file that plays the recording.

        with HtmlRecording(meshcat, "out/run.html", title="Hang a mug"):
            simulator.AdvanceTo(30.0)

    The file is written even if the block raises. Open pages offer the recording for playback, too.

    Args:
        meshcat: What to record. An older recording is dropped.
        path: The HTML file; its folder is created if needed.
        title: The page's title.
        frames_per_second: The recording's frame rate [1/s], ideally the rate at which systems
            publish to Meshcat. A lower rate loses frames; a higher rate makes playback stutter.

    Yields:
        The file's path.
    """
    path = Path(path)
    meshcat.DeleteRecording()
    meshcat.StartRecording(frames_per_second=frames_per_second)
    try:
        yield path
    finally:
        meshcat.StopRecording()
        meshcat.PublishRecording()
        tag = f"<title>{html.escape(title)}</title>"
        old = re.compile(r"<title>.*?</title>", flags=re.DOTALL)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(old.sub(lambda _: tag, meshcat.StaticHtml(), count=1), encoding="utf-8")

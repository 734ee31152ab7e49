"""The live Meshcat page, and the recording of a run as one HTML file."""

import html
import re
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams

from poil_drake.errors import StationError


@dataclass(frozen=True, kw_only=True)
class MeshcatViewConfig:
    """What a viewer sees first.

    Attributes:
        camera_position: The viewer's place [m, world]: in front of the robot and a little above,
            so that the object, the fixture and the arm are in the picture.
        camera_target: What the viewer looks at [m, world].
        show_grid: Whether the grid of the ground is drawn; a table hides it in part.
        show_axes: Whether the world's axes are drawn.
    """

    camera_position: tuple[float, float, float] = (1.60, -0.10, 0.82)
    camera_target: tuple[float, float, float] = (0.30, 0.06, 0.34)
    show_grid: bool = False
    show_axes: bool = False


def MakeMeshcat(
    *, host: str = "localhost", port: int | None = None, view: MeshcatViewConfig | None = None
) -> Meshcat:
    """Starts Meshcat's server; `web_url()` of what is returned is the page to open.

    Args:
        host: Where to listen. The default is this machine only; "*" is every network interface,
            for a viewer on another machine.
        port: The TCP port; None takes the first free one from 7000 to 7999.
        view: What a viewer sees first.

    Raises:
        StationError: if the port is taken.
    """
    try:
        meshcat = Meshcat(MeshcatParams(host=host, port=port, show_stats_plot=False))
    except RuntimeError as error:
        raise StationError(
            f"Meshcat cannot listen on {host}:{port or '7000-7999'} ({error}).",
            remedy="Choose another port, or none to take the first that is free.",
        ) from error
    SetMeshcatView(meshcat, view or MeshcatViewConfig())
    return meshcat


def SetMeshcatView(meshcat: Meshcat, view: MeshcatViewConfig) -> None:
    """Points the page's camera, and shows or hides grid and axes."""
    meshcat.SetProperty("/Grid", "visible", view.show_grid)
    meshcat.SetProperty("/Axes", "visible", view.show_axes)
    meshcat.SetCameraPose(np.array(view.camera_position), np.array(view.camera_target))


class HtmlRecording:
    """Records what is drawn in Meshcat and writes it as one HTML file that plays by itself.

    As a `with` block it records the block and writes the file even if the block raises:

        with HtmlRecording(meshcat, "out/run.html", title="Hang a mug"):
            simulator.AdvanceTo(30.0)

    The frame rate should be that of what publishes to Meshcat: at a lower one frames are lost, at a
    higher one playback stutters.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        path: str | Path,
        *,
        title: str = "poil_drake",
        frames_per_second: float = 32.0,
        live: bool = True,
    ):
        """Prepares; nothing is recorded or written yet.

        Args:
            meshcat: What to record.
            path: The HTML file; its folder is made where needed.
            title: The page's title.
            frames_per_second: The recording's frame rate [1/s].
            live: Whether open pages follow while recording. Off, a run without viewers is faster.
        """
        self._meshcat, self._path, self._title = meshcat, Path(path), title
        self._frames_per_second, self._live = frames_per_second, live

    @property
    def path(self) -> Path:
        """Where the file is written."""
        return self._path

    def start(self) -> None:
        """Begins a new recording; an older one is dropped."""
        self._meshcat.DeleteRecording()
        self._meshcat.StartRecording(
            frames_per_second=self._frames_per_second,
            set_visualizations_while_recording=self._live,
        )

    def stop(self) -> None:
        """Ends the recording and offers it for playback in open pages, too."""
        self._meshcat.StopRecording()
        self._meshcat.PublishRecording()

    def write(self) -> Path:
        """Writes the file and returns its path."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        page = _with_title(self._meshcat.StaticHtml(), self._title)
        self._path.write_text(page, encoding="utf-8")
        return self._path

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        exception_type: type[BaseException] | None,
        exception: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()
        self.write()


def _with_title(page: str, title: str) -> str:
    """Returns an HTML page with its title, or the head's first line, set to `title`."""
    tag = f"<title>{html.escape(title)}</title>"
    head, separator, rest = page.partition("</head>")
    head, count = re.subn(r"<title>.*?</title>", lambda _: tag, head, count=1, flags=re.DOTALL)
    return (head if count else head.replace("<head>", f"<head>\n{tag}", 1)) + separator + rest

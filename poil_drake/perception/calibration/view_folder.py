"""Views of a calibration board in a folder: images, and where the arm was.

An image is named <view>_<camera>.png, e.g. 03_left.png. If the board is on the hand,
`joint_positions.csv` has a row for each view: its name, then the arm's joint positions [rad].
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from poil_drake.errors import CalibrationError
from poil_drake.perception.images import CameraModel
from poil_drake.robots.panda import ARM_JOINTS, NUM_JOINTS

POSITIONS_FILE = "joint_positions.csv"

_HEADER = ("view", *ARM_JOINTS)


@dataclass(frozen=True, eq=False)
class View:
    """The images of one instant.

    Attributes:
        name: The view's name.
        images: Camera -> (H, W, 3) uint8 image.
        q: (7,) joint positions of the arm [rad]; None for a loose board.
    """

    name: str
    images: Mapping[str, np.ndarray] = field(default_factory=dict)
    q: np.ndarray | None = None


def save_view(folder: Path, view: View) -> None:
    """Adds a view to a folder, which is created if needed."""
    folder.mkdir(parents=True, exist_ok=True)
    for camera, image in view.images.items():
        _, png = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        (folder / f"{view.name}_{camera}.png").write_bytes(png.tobytes())
    if view.q is not None:
        path = folder / POSITIONS_FILE
        rows = [] if path.exists() else [_HEADER]
        with path.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([*rows, (view.name, *(f"{q:.9f}" for q in view.q))])


def load_views(folder: Path, cameras: Sequence[CameraModel], *, on_hand: bool) -> list[View]:
    """Returns the views in a folder. Images of other cameras are ignored.

    Args:
        folder: The folder.
        cameras: The cameras.
        on_hand: Whether each view needs joint positions.

    Raises:
        CalibrationError: if the folder has no image of the cameras, an image cannot be read or has
            the wrong size, or joint positions are missing or damaged.
    """
    paths = sorted(folder.glob("*_*.png"))
    sizes = {camera.name: (camera.height, camera.width) for camera in cameras}
    views: dict[str, dict[str, np.ndarray]] = {}
    for path in paths:
        name, _, camera = path.stem.partition("_")
        if camera in sizes:
            views.setdefault(name, {})[camera] = _read_image(path, sizes[camera])
    if not views:
        found = ", ".join(sorted({path.stem.partition("_")[2] for path in paths})) or "none"
        raise CalibrationError(
            f"'{folder}' has no images of {' or '.join(sizes)}; cameras in its images: {found}.",
            remedy="Name the images <view>_<camera>.png, e.g. 03_left.png, with the names of the "
            "scenario's cameras, or take views with --hardware.",
        )
    positions = _read_positions(folder / POSITIONS_FILE) if on_hand else {}
    if on_hand and (missing := views.keys() - positions.keys()):
        raise CalibrationError(
            f"'{folder / POSITIONS_FILE}' has no row for view '{min(missing)}'.",
            remedy="Add the view's joint positions, or remove its images.",
        )
    return [View(name, images, positions.get(name)) for name, images in views.items()]


def _read_image(path: Path, size: tuple[int, int]) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(path.read_bytes() or b"\0", np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise CalibrationError(f"The image '{path}' cannot be read.", remedy="Remove it.")
    if image.shape[:2] != size:
        raise CalibrationError(
            f"The image '{path}' has {image.shape[1]} x {image.shape[0]} pixels, but the camera in "
            f"the scenario has {size[1]} x {size[0]}.",
            remedy="Set the camera's size and intrinsics in the scenario to those of the images.",
        )
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def _read_positions(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise CalibrationError(
            f"There is no '{path}', which says where the hand held the board.",
            remedy=f"Write it, with the columns {', '.join(_HEADER)} [rad]; or, for a loose board, "
            "name the camera whose pose is right with --keep.",
        )
    found = {}
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    for number, row in enumerate(csv.reader(text.splitlines()), start=1):
        if not row or row[0] == "view":
            continue
        try:
            q = np.array([float(value) for value in row[1:]])
        except ValueError:
            q = np.array([np.nan])
        if q.shape != (NUM_JOINTS,) or not (np.abs(q) < 2.0 * np.pi).all():
            raise CalibrationError(
                f"Line {number} of '{path}' is not a view's name and {NUM_JOINTS} angles: "
                f"{','.join(row)[:80]}",
                remedy="Write the name of the view, then the arm's joint positions in radians.",
            )
        found[row[0].strip()] = q
    return found

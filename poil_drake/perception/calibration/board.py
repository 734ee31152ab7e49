"""The calibration board: its pattern, its corners in images, and its picture for the printer."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError

_MIN_CORNERS = 6
"""Fewer corners in an image do not count as a view of the board."""

_DPI = 300.0  # Least resolution of the picture [dots per inch].
_MARGIN = 0.01  # White border of the printed board [m]; printers need 5 mm.
_INCH = 0.0254  # [m]


@dataclass(frozen=True, kw_only=True)
class BoardConfig:
    """A ChArUco board: a chessboard with a marker in each white square.

    The default fits on A4 paper, and its markers are large enough for 640 x 480 pixels at 0.8 m.

    Attributes:
        columns: Number of squares along the board's x axis.
        rows: Number of squares along the board's y axis.
        square: Edge of a square [m]. Measure it on the print: printers scale.
        marker: Edge of a marker [m]; 0 means three quarters of the square.
        dictionary: Name of the markers' dictionary in OpenCV, without "DICT_".
    """

    columns: int = 7
    rows: int = 5
    square: float = 0.038
    marker: float = 0.0
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3:
            raise InvalidValueError(
                f"A calibration board of {self.columns} x {self.rows} squares is too small.",
                remedy="Use at least 3 x 3 squares.",
            )
        if not (0.0 < self.square < 1.0 and 0.0 <= self.marker < self.square):
            raise InvalidValueError(
                f"A calibration board has squares of {self.square} m with markers of "
                f"{self.marker} m.",
                remedy="Give both in metres; a marker is smaller than its square.",
            )
        names = [name[5:] for name in dir(cv2.aruco) if name.startswith("DICT_")]
        if self.dictionary not in names:
            raise InvalidValueError(
                f"The dictionary of markers '{self.dictionary}' is not known.",
                remedy=f"Choose one of: {', '.join(names)}.",
            )


class CalibrationBoard:
    """Finds a board's inner corners in images.

    The board's frame has its origin at a corner of the board, x along the rows of squares, y along
    the columns, and z into the board.

    Attributes:
        config: The board.
        corners: (N, 3) inner corners in the board's frame [m].
    """

    def __init__(self, config: BoardConfig | None = None):
        """Constructs the board; None is the default board.

        Raises:
            InvalidValueError: if the dictionary has too few markers.
        """
        self.config = config = config or BoardConfig()
        dictionary = cv2.aruco.getPredefinedDictionary(
            getattr(cv2.aruco, f"DICT_{config.dictionary}")
        )
        needed, found = config.columns * config.rows // 2, len(dictionary.bytesList)
        if needed > found:
            raise InvalidValueError(
                f"A board of {config.columns} x {config.rows} squares needs {needed} markers, but "
                f"the dictionary {config.dictionary} has {found}.",
                remedy="Use fewer squares or a larger dictionary.",
            )
        self._board = cv2.aruco.CharucoBoard(
            (config.columns, config.rows),
            config.square,
            config.marker or 0.75 * config.square,
            dictionary,
        )
        self._detector = cv2.aruco.CharucoDetector(self._board)
        self.corners = np.asarray(self._board.getChessboardCorners(), dtype=float)

    def detect(self, rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Returns the indices (K,) of visible corners and their pixels (K, 2), or None.

        Args:
            rgb: (H, W, 3) uint8 image without lens distortion.

        Returns:
            Indices into `corners`, and pixels with sub-pixel accuracy; None if fewer than 6
            corners are visible, or if they lie on one line.
        """
        pixels, ids, _, _ = self._detector.detectBoard(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
        if ids is None or len(ids) < _MIN_CORNERS:
            return None
        if self._board.checkCharucoCornersCollinear(ids):
            return None
        return ids.ravel().astype(int), pixels.reshape(-1, 2).astype(float)

    def save(self, path: Path) -> tuple[float, float]:
        """Writes the board as PDF or PNG, to be printed at 100 %, and returns its size [m].

        Args:
            path: The file; its suffix is .pdf or .png.

        Returns:
            Width and height of the page, of which 10 mm on each side are margins [m].

        Raises:
            InvalidValueError: if the file has another suffix.
        """
        from PIL import Image

        if path.suffix not in (".pdf", ".png"):
            raise InvalidValueError(
                f"The board cannot be written to '{path}'.", remedy="Use the suffix .pdf or .png."
            )
        config = self.config
        pixels = int(np.ceil(config.square * _DPI / _INCH))  # Whole pixels keep all squares equal.
        dpi = pixels / config.square * _INCH
        margin = round(_MARGIN * dpi / _INCH)
        size = (config.columns * pixels, config.rows * pixels)
        page = cv2.copyMakeBorder(
            self._board.generateImage(size), *(margin,) * 4, cv2.BORDER_CONSTANT, value=255
        )
        caption = (
            f"poil {config.columns} x {config.rows}, {config.dictionary}: print at 100 %, then "
            f"measure the squares: {1e3 * config.square:g} mm?"
        )
        scale = dpi / _DPI
        cv2.putText(
            page,
            caption,
            (margin, margin + size[1] + round(0.7 * margin)),
            cv2.FONT_HERSHEY_SIMPLEX,
            1.6 * scale,
            128,
            round(3 * scale),
            cv2.LINE_AA,
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(page).save(path, dpi=(dpi, dpi), resolution=dpi)
        return page.shape[1] / dpi * _INCH, page.shape[0] / dpi * _INCH

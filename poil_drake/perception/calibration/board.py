"""The calibration board: its pattern, its corners in images, and its picture for the printer."""

from pathlib import Path

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError

_MIN_CORNERS = 6  # Fewer corners in an image do not count as a view of the board.
_DPI = 300.0  # Least resolution of the picture [dots per inch].
_MARGIN = 0.01  # White border of the printed board [m]; printers need 5 mm.
_INCH = 0.0254  # [m]


class CalibrationBoard:
    """A ChArUco board, which is a chessboard with a marker in each white square.

    The board's frame has its origin at a corner of the board, x along the rows of squares, y along
    the columns, and z into the board.

    Attributes:
        columns: Number of squares along the board's x axis.
        rows: Number of squares along the board's y axis.
        square: Edge of a square [m].
        dictionary: Name of the markers' dictionary in OpenCV, without "DICT_".
        corners: (N, 3) inner corners in the board's frame [m].
    """

    def __init__(
        self,
        columns: int = 7,
        rows: int = 5,
        *,
        square: float = 0.038,
        marker: float = 0.0,
        dictionary: str = "4X4_50",
    ):
        """Constructs the board.

        The default fits on A4 paper, and its markers are large enough for 640 x 480 pixels at
        0.8 m.

        Args:
            columns: See above; at least 3.
            rows: See above; at least 3.
            square: See above. Measure it on the print: printers scale.
            marker: Edge of a marker [m]; 0 means three quarters of the square.
            dictionary: See above.

        Raises:
            InvalidValueError: if there is no such board.
        """
        marker = marker or 0.75 * square
        if not (min(columns, rows) >= 3 and 0.0 < marker < square < 1.0):
            raise InvalidValueError(
                f"A calibration board cannot have {columns} x {rows} squares of {square:g} m with "
                f"markers of {marker:g} m.",
                remedy="Use at least 3 x 3 squares, and give their edge, and the smaller one of "
                "the markers, in metres.",
            )
        names = [name[5:] for name in dir(cv2.aruco) if name.startswith("DICT_")]
        if dictionary not in names:
            raise InvalidValueError(
                f"The dictionary of markers '{dictionary}' is not known.",
                remedy=f"Choose one of: {', '.join(names)}.",
            )
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
        needed, found = columns * rows // 2, len(markers.bytesList)
        if needed > found:
            raise InvalidValueError(
                f"A board of {columns} x {rows} squares needs {needed} markers, but the "
                f"dictionary {dictionary} has {found}.",
                remedy="Use fewer squares or a larger dictionary.",
            )
        self.columns, self.rows, self.square, self.dictionary = columns, rows, square, dictionary
        self._board = cv2.aruco.CharucoBoard((columns, rows), square, marker, markers)
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
        # Whole pixels keep all squares equal.
        pixels = int(np.ceil(self.square * _DPI / _INCH))
        dpi = pixels / self.square * _INCH
        margin = round(_MARGIN * dpi / _INCH)
        size = (self.columns * pixels, self.rows * pixels)
        page = cv2.copyMakeBorder(
            self._board.generateImage(size), *(margin,) * 4, cv2.BORDER_CONSTANT, value=255
        )
        caption = (
            f"poil {self.columns} x {self.rows}, {self.dictionary}: print at 100 %, then "
            f"measure the squares: {1e3 * self.square:g} mm?"
        )
        below = (margin, margin + size[1] + round(0.7 * margin))
        cv2.putText(page, caption, below, cv2.FONT_HERSHEY_SIMPLEX, 1.6, 128, 3, cv2.LINE_AA)
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(page).save(path, dpi=(dpi, dpi), resolution=dpi)
        return page.shape[1] / dpi * _INCH, page.shape[0] / dpi * _INCH

"""The `poil calibrate` verbs: the calibration board, and the cameras' poses."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poil_drake.cli import options
from poil_drake.cli.options import choose_scenario, names
from poil_drake.runtime.output_files import require_writable

if TYPE_CHECKING:
    from poil_drake.perception.calibration.board import CalibrationBoard

calibrate_app = typer.Typer(no_args_is_help=True, help="Calibrate the cameras' poses.")

Squares = Annotated[str, typer.Option("--squares", help="Numbers of squares of the board.")]
Square = Annotated[
    float, typer.Option("--square", help="Edge of a square, measured on the print (metres).")
]
Marker = Annotated[
    float, typer.Option("--marker", help="Edge of a marker (metres). 0: 3/4 of the square.")
]
Dictionary = Annotated[
    str, typer.Option("--dictionary", help="OpenCV's dictionary of the markers, without DICT_.")
]


def _board(squares: str, square: float, marker: float, dictionary: str) -> "CalibrationBoard":
    from poil_drake.perception.calibration.board import CalibrationBoard

    columns, _, rows = squares.partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise typer.BadParameter(f"--squares is '{squares}', not two numbers such as 7x5.")
    return CalibrationBoard(
        int(columns), int(rows), square=square, marker=marker, dictionary=dictionary
    )


@calibrate_app.command("board")
def calibrate_board(
    output: Annotated[Path, typer.Option("-o", "--output", help="A .pdf or .png file.")] = Path(
        "out/board.pdf"
    ),
    squares: Squares = "7x5",
    square: Square = 0.038,
    marker: Marker = 0.0,
    dictionary: Dictionary = "4X4_50",
) -> None:
    """Write a calibration board (ChArUco) to print. The default fits on A4."""
    board = _board(squares, square, marker, dictionary)
    require_writable(output)
    width, height = board.save(output)
    typer.echo(f"wrote {output}, {1e3 * width:.0f} mm x {1e3 * height:.0f} mm")
    typer.echo("print it at 100 %, glue it to a flat plate, and measure a row of squares")


@calibrate_app.command("cameras")
def calibrate_cameras(
    scenario: options.ScenarioArgument = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The poses (YAML).")] = Path(
        "out/cameras.yaml"
    ),
    views: Annotated[
        Path,
        typer.Option("--views", help="Folder of views, or a recording (.mcap) of a loose board."),
    ] = Path("out/calibration_views"),
    hardware: Annotated[
        bool, typer.Option("--hardware", help="Take the views with the real cameras now.")
    ] = False,
    keep: Annotated[
        str | None,
        typer.Option(
            "--keep",
            metavar="CAMERA",
            help="The board is loose; keep this camera's pose. Default: the hand holds the board.",
        ),
    ] = None,
    cameras: Annotated[
        str | None, typer.Option("--cameras", help="Comma-separated. Default: all.")
    ] = None,
    squares: Squares = "7x5",
    square: Square = 0.038,
    marker: Marker = 0.0,
    dictionary: Dictionary = "4X4_50",
    scenario_name: options.ScenarioName = None,
    scenario_text: options.ScenarioText = None,
) -> None:
    """Find the poses of fixed cameras with a calibration board.

    With the board on the hand, the poses are relative to the robot's base; with a loose board,
    relative to the camera --keep. The output is for the scenario key poil.calibration; a picture
    beside it shows the errors.
    """
    from poil_drake.diagrams.calibration.calibration_file import RequireCalibrationPath
    from poil_drake.diagrams.calibration.camera_calibration import (
        CalibrateCameras,
        TakeViews,
    )

    chosen = choose_scenario(scenario, scenario_name, scenario_text)
    board = _board(squares, square, marker, dictionary)
    picture = output.with_suffix(".png")
    for path in (output, picture):
        require_writable(path, inputs=(chosen.source.file,))
    RequireCalibrationPath(output)
    if hardware:
        TakeViews(chosen, views, board, cameras=names(cameras), kept=keep, ask=_ask)
    result = CalibrateCameras(
        chosen,
        views,
        board,
        cameras=names(cameras),
        kept=keep,
        output=output,
        picture=picture,
    )
    for name, found in result.cameras.items():
        focal = found.focal_length
        typer.echo(f"{name:<10} reprojection error {found.rms:.2f} px (RMS), {found.error_text}")
        typer.echo(
            f"           focal length {focal.stated:.1f} px as stated, {focal.found:.1f} +- "
            f"{focal.error:.1f} px by the views"
        )
    if result.left_out:
        images = ", ".join(view.name for view in result.left_out)
        typer.echo(f"left out, as they do not fit the others: {images}")
    if (edge := result.square) is not None:
        typer.echo(
            f"squares    {1e3 * edge.stated:.2f} mm as stated, {1e3 * edge.found:.2f} +- "
            f"{1e3 * edge.error:.2f} mm by the hand's motions"
        )
    typer.echo(f"wrote the poses to {output}, and a picture of the errors to {picture}")
    typer.echo(f"to use them, set in the scenario: poil: {{ calibration: {output.resolve()} }}")


def _ask(prompt: str) -> bool:
    """Returns whether the user wants another view; the end of the input means no."""
    try:
        return input(f"{prompt} ").strip().lower() not in ("q", "quit")
    except EOFError:
        return False

"""The verb `poil label`: draw boxes and clicks on a scene's images."""

from pathlib import Path
from typing import Annotated

import typer

from poil_drake.cli import options
from poil_drake.runtime.output_files import require_writable


def label(
    scene: Annotated[
        Path,
        typer.Argument(
            metavar="DEMO|SCENARIO", help="A demonstration (.mcap), or a scenario file (.yaml)."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Default: <name>.labels.json beside DEMO|SCENARIO."),
    ] = None,
    hardware: Annotated[
        bool,
        typer.Option("--hardware", help="With a scenario: images of the real cameras, taken now."),
    ] = False,
    seed: options.Seed = None,
    scenario_name: options.ScenarioName = None,
    scenario_text: options.ScenarioText = None,
) -> None:
    """Mark object, part and fixture by hand, on a local page.

    The page shows the first images of a demonstration, or a scenario's cameras. Drag a box around
    something, or click on it; the masks that follow are shown. Every mark is saved at once. A file
    that exists is continued.
    """
    from poil_drake.perception.detectors.by_hand.detector import hand_label_masks
    from poil_drake.perception.detectors.by_hand.hand_labels import ROLES, HandLabels, labels_path
    from poil_drake.perception.detectors.by_hand.label_file import LabelFile
    from poil_drake.reports.mark_page import MarkPage

    path = output or labels_path(scene)
    require_writable(path, inputs=(scene,))
    if scene.suffix == ".mcap":
        if hardware or any(v is not None for v in (seed, scenario_name, scenario_text)):
            raise typer.BadParameter("The options of a scenario do not work with a demonstration.")
        from poil_drake.recording.demonstration.demonstration import load_demonstration

        frame = load_demonstration(scene).frames[0]
    else:
        from poil_drake.diagrams.station.station import CaptureScene

        chosen = options.choose_scenario(scene, scenario_name, scenario_text, seed=seed)
        frame = CaptureScene(chosen, hardware=hardware)
    store, blank = LabelFile(path, frame), HandLabels.of(frame)
    store.read()  # Labels of another scene are refused before the page opens.
    images = zip(frame.cameras, frame.images, strict=True)
    with MarkPage(
        title=f"{scene.name}: mark {', '.join(ROLES)}",
        images={camera.name: image.rgb for camera, image in images},
        roles=ROLES,
        store=store,
        masks=lambda marks: hand_label_masks(frame, blank.with_marks(marks)),
    ) as page:
        typer.echo(f"open {page.url}")
        page.wait()
    typer.echo(f"{len(store.read())} marks are in {path}")

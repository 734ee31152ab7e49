"""`poil bench tracking`: trackers on rendered sequences, with and without faults."""

from collections import defaultdict
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from tqdm import tqdm

from poil_drake.benchmarks.tracking.cases import CASES
from poil_drake.benchmarks.tracking.measures import Track, false_alarms, recovery_time, summarize
from poil_drake.benchmarks.tracking.pictures import draw_figures, draw_tracks
from poil_drake.benchmarks.tracking.trial import TrackedTrial, run_trial
from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.errors import InvalidValueError
from poil_drake.perception.trackers.registry import TRACKERS
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.reports.progress import OneLineTqdm

Row = tuple[str, bool, str]
"""Tracker, whether it has a prior, and case."""

Figures = dict[str, float | int | str]
"""The figures of a row by name, see `summarize`; "problem" is why trials could not run."""


def run_tracking_benchmark(
    *,
    trackers: Sequence[str],
    cases: Sequence[str],
    trials: int,
    priors: Sequence[bool] = (True, False),
    jobs: int = 1,
    json_path: Path,
    pictures: Path | None = None,
    max_frames: int | None = None,
    data: str | None = None,
    ray_address: str | None = None,
) -> dict[Row, Figures]:
    """Runs the trials, prints a table, draws it, and writes all results as JSON.

    Args:
        trackers: Names in `TRACKERS`.
        cases: Names in `CASES`.
        trials: Number of trials, with seeds 0 to trials - 1.
        priors: Whether trackers get the motion of the hand: True, False or both.
        jobs: Number of trials at the same time; frames per second are comparable only with one.
        json_path: JSON file for the results, written after every trial.
        pictures: Folder for `tracking.png` and `tracking_<case>.png`; None for the JSON file's.
        max_frames: Frames of each sequence; None for all.
        data: YAML merged over the package's scenario.
        ray_address: Address of a Ray cluster, see `run_trials`; None for this machine.

    Returns:
        For each tracker, with and without prior, in each case: its figures, see `summarize`; or
        "problem", why it could not run.

    Raises:
        InvalidValueError: if a tracker or a case is unknown.
    """
    for kind, given, known in (("tracker", trackers, TRACKERS), ("fault", cases, CASES)):
        for name in given:
            if name not in known:
                raise InvalidValueError(
                    f"There is no {kind} '{name}'.", remedy=f"Choose from: {', '.join(known)}."
                )
    found: list[TrackedTrial] = []
    table: dict[Row, Figures] = {}
    ends = run_trials(
        run_trial,
        [(seed,) for seed in range(trials)],
        shared=(tuple(trackers), tuple(cases), tuple(priors), max_frames, data),
        jobs=jobs,
        ray_address=ray_address,
    )
    with closing(ends), OneLineTqdm(total=trials, desc="trials") as bar:
        for _, end in ends:
            if isinstance(end, LostTrial):
                tqdm.write(str(end))
            else:
                found += end
            bar.update()
            table = _table(found)
            _write(table, found, json_path)
    _print(table)
    folder = json_path.parent if pictures is None else pictures
    draw_figures(table, folder / "tracking.png")
    for case in cases:
        draw_tracks([t for t in found if t.case == case], folder / f"tracking_{case}.png")
    return table


def _table(found: Sequence[TrackedTrial]) -> dict[Row, Figures]:
    tracks: dict[Row, list[Track]] = defaultdict(list)
    problems: dict[Row, list[str]] = defaultdict(list)
    for one in found:
        row = (one.tracker, one.prior, one.case)
        problems[row] += [one.problem] if one.problem else []
        tracks[row] += [one.track] if one.track is not None else []
    return {
        row: {
            **(summarize(tracks[row]) if tracks[row] else {}),
            **(
                {"problem": problems[row][0], "not_run": len(problems[row])}
                if problems[row]
                else {}
            ),
        }
        for row in problems
    }


def _write(table: dict[Row, Figures], found: Sequence[TrackedTrial], path: Path) -> None:
    rows = [
        {"tracker": tracker, "prior": prior, "case": case, **figures}
        for (tracker, prior, case), figures in table.items()
    ]
    trials = []
    for one in sorted(found, key=lambda t: t.seed):
        entry = {"seed": one.seed, "case": one.case, "tracker": one.tracker, "prior": one.prior}
        if one.track is not None:
            track = one.track
            entry |= {
                "times": track.times,
                "mean_errors": track.mean_errors,
                "lost": track.lost,
                "confidence": track.confidence,
                "visible": track.visible,
                "recovery": recovery_time(track),
                "false_alarms": false_alarms(track)[0],
            }
        trials.append(entry | ({"problem": one.problem} if one.problem else {}))
    write_json({"summary": rows, "trials": trials}, path, indent=None)


def _print(table: dict[Row, Figures]) -> None:
    print(
        f"{'tracker':24s} {'fault':12s} {'error [mm]':>13s} {'hidden':>11s} {'wrong':>11s} "
        f"{'recovered':>16s} {'false':>6s} {'frames':>7s}"
    )
    print(
        f"{'':24s} {'':12s} {'median/95 %':>13s} {'noticed':>11s} {'noticed':>11s} "
        f"{'<= 1 s, longest':>16s} {'alarms':>6s} {'/s':>7s}"
    )
    for (tracker, prior, case), f in table.items():
        name = f"{tracker}{'' if prior else ', no prior'}"
        if "error_median" not in f:
            print(f"{name:24s} {case:12s} {f['problem']}")
            continue
        error = f"{1e3 * float(f['error_median']):.1f}/{1e3 * float(f['error_p95']):.1f}"
        recovered = f"{_percent(f['recovered'])}, {float(f['recovery_longest']):.2f} s"
        print(
            f"{name:24s} {case:12s} {error:>13s} "
            f"{_percent(f['hidden_noticed']) + ' of ' + str(f['hidden']):>11s} "
            f"{_percent(f['wrong_noticed']) + ' of ' + str(f['wrong']):>11s} "
            f"{recovered if f['recovered'] == f['recovered'] else '-':>16s} "
            f"{_percent(f['false_alarms']):>6s} {float(f['frames_per_second']):7.1f}"
            f"{'  ' + str(f['problem']) if 'problem' in f else ''}"
        )


def _percent(share: float | str) -> str:
    return "-" if share != share else f"{float(share):.1%}"

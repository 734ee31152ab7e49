"""Runs the model of a learned tracker, in its own environment; a script for `ScriptProcess`.

It imports nothing of this package, since that is not installed there.
"""

from collections.abc import Callable, Mapping

import numpy as np

Arrays = Mapping[str, np.ndarray]
Track = Callable[[list[Arrays], Arrays], Arrays]


def make_handler(setup: Mapping[str, str]) -> Callable[[Arrays], Arrays]:
    """Loads a model, and returns the function that tracks points through a clip.

    Of a request, `clip` (T,) holds the numbers of the clip's frames; `<number>/<name>` are the
    arrays of frames that are new, and `forgotten` holds the numbers of those that come no more.

    Args:
        setup: `model`, "mvtracker" or "cotracker3"; `repository`, the folder with hubconf.py;
            `weights`, the file of the model's weights; `device`, PyTorch's name of the device, or
            empty for a GPU if there is one.
    """
    import torch

    load = {"mvtracker": _load_mvtracker, "cotracker3": _load_cotracker3}[setup["model"]]
    device = setup["device"] or ("cuda" if torch.cuda.is_available() else "cpu")
    track = load({**setup, "device": device})
    frames: dict[int, dict[str, np.ndarray]] = {}

    def handle(request: Arrays) -> Arrays:
        for number in request["forgotten"]:
            frames.pop(int(number), None)
        for path, array in request.items():
            number, slash, name = path.partition("/")
            if slash:
                frames.setdefault(int(number), {})[name] = array
        return track([frames[int(number)] for number in request["clip"]], request)

    return handle


def _load_mvtracker(setup: Mapping[str, str]) -> Track:
    """Returns MVTracker's function of the clip's frames and the request, in the model's units.

    A frame has `rgb` (V, H, W, 3) uint8 and `depth` (V, H, W), 0 where invalid; the request `K`
    (V, 3, 3) [px], `X_CW` (V, 3, 4), world to camera, and `queries` (Q, 4): index in the clip,
    position. The answer has `tracks` (T, Q, 3) and `visibility` (T, Q), a probability.
    """
    import torch

    predictor = torch.hub.load(
        setup["repository"],
        "mvtracker_predictor",
        source="local",
        pretrained=False,
        device=setup["device"],
        # Its own support points would lie at a camera's centre where depth is missing.
        predictor_kwargs={"grid_size": 0},
    )
    weights = torch.load(setup["weights"], map_location="cpu", weights_only=True)
    for key in ("state_dict", "model"):
        weights = weights[key] if isinstance(weights.get(key), dict) else weights
    weights = {name.removeprefix("model."): value for name, value in weights.items()}
    _, unexpected = predictor.model.load_state_dict(weights, strict=False)
    if unexpected:
        raise ValueError(f"{setup['weights']} holds the weights of another model: {unexpected[:3]}")
    predictor = predictor.to(setup["device"]).eval()
    kind = torch.device(setup["device"]).type
    old = kind == "cuda" and torch.cuda.get_device_capability(setup["device"])[0] < 8
    torch.set_float32_matmul_precision("high")

    def tensor(array: np.ndarray) -> "torch.Tensor":
        """Returns a batch of one, as float32 on the device."""
        if not np.isfinite(array).all():
            raise ValueError("The request is not finite.")  # The model would open a debugger.
        return torch.tensor(array).to(setup["device"]).float()[None]

    def track(clip: list[Arrays], request: Arrays) -> Arrays:
        rgb = np.stack([frame["rgb"] for frame in clip], axis=1)
        depth = np.stack([frame["depth"] for frame in clip], axis=1)
        half = torch.float16 if old else torch.bfloat16
        with torch.no_grad(), torch.autocast(kind, dtype=half, enabled=kind == "cuda"):
            answer = predictor(
                rgbs=tensor(rgb).permute(0, 1, 2, 5, 3, 4),  # 0 to 255
                depths=tensor(depth)[:, :, :, None],
                intrs=tensor(request["K"])[:, :, None].expand(-1, -1, len(clip), -1, -1),
                extrs=tensor(request["X_CW"])[:, :, None].expand(-1, -1, len(clip), -1, -1),
                query_points_3d=tensor(request["queries"]),
            )
        return {
            "tracks": answer["traj_e"][0].float().cpu().numpy(),
            "visibility": answer["vis_e_as_prob"][0].float().cpu().numpy(),
        }

    return track


def _load_cotracker3(setup: Mapping[str, str]) -> Track:
    """Returns the function of the online model of CoTracker3, for one window of T frames.

    A frame has `rgb_<i>` (H, W, 3) uint8 for each view i; the request `queries_<i>` (Q, 3) for some
    views: index in the window, u, v [px]. For these, the answer has `tracks_<i>` (T, Q, 2) [px] and
    `visible_<i>` (T, Q) bool.
    """
    import torch

    predictor = torch.hub.load(
        setup["repository"], "cotracker3_online", source="local", pretrained=False
    )
    weights = torch.load(setup["weights"], map_location="cpu", weights_only=True)
    predictor.model.load_state_dict(weights)
    predictor = predictor.to(setup["device"]).eval()

    def tensor(array: np.ndarray) -> "torch.Tensor":
        """Returns a batch of one, as float32 on the device."""
        return torch.tensor(array).to(setup["device"]).float()[None]

    def track(clip: list[Arrays], request: Arrays) -> Arrays:
        answer = {}
        for view in [name[len("queries_") :] for name in request if name.startswith("queries_")]:
            video = tensor(np.stack([frame[f"rgb_{view}"] for frame in clip]))
            video = video.permute(0, 1, 4, 2, 3)  # 0 to 255
            options = {"grid_size": 0, "add_support_grid": True}
            with torch.no_grad():
                # The first call only stores the queries and clears the last window.
                queries = tensor(request[f"queries_{view}"])
                predictor(video_chunk=video, is_first_step=True, queries=queries, **options)
                tracks, visible = predictor(video_chunk=video, **options)
            answer[f"tracks_{view}"] = tracks[0].cpu().numpy()
            answer[f"visible_{view}"] = visible[0].cpu().numpy()
        return answer

    return track

"""Runs CoTracker3's online model, in its own environment. `ScriptProcess` calls `make_handler`.

It imports nothing of this package, since that is not installed there.
"""

from collections.abc import Callable, Mapping

import numpy as np


def make_handler(setup: Mapping[str, str]) -> Callable[[dict], dict]:
    """Loads the model, and returns the function that tracks pixels through a window.

    Args:
        setup: `repository`, the folder with hubconf.py; `weights`, the file of the model's weights;
            `device`, PyTorch's name of the device.
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

    def track(request: dict) -> dict:
        """Tracks pixels through one window of T frames of each view.

        Args:
            request: For each view i, `rgb_<i>` (T, H, W, 3) uint8 and `queries_<i>` (Q, 3): frame
                in the window, u, v [px].

        Returns:
            For each view i, `tracks_<i>` (T, Q, 2) [px] and `visible_<i>` (T, Q) bool.
        """
        answer = {}
        for name in [name for name in request if name.startswith("rgb_")]:
            view = name.removeprefix("rgb_")
            video = tensor(request[name]).permute(0, 1, 4, 2, 3)  # 0 to 255
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

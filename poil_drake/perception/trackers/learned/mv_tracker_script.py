"""Runs MVTracker, in its own environment. `ScriptProcess` calls `make_handler`.

It imports nothing of this package, since that is not installed there.
"""

from collections.abc import Callable, Mapping

import numpy as np


def make_handler(setup: Mapping[str, str]) -> Callable[[dict], dict]:
    """Loads the model, and returns the function that tracks points through a clip.

    Args:
        setup: `repository`, the folder with hubconf.py; `weights`, the file of the model's weights;
            `device`, PyTorch's name of the device.
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
        return torch.tensor(array).to(setup["device"]).float()[None]

    def track(request: dict) -> dict:
        """Tracks points through a clip of T frames of V views, in the model's units.

        Args:
            request: `rgb` (V, T, H, W, 3) uint8; `depth` (V, T, H, W), 0 where invalid; `K`
                (V, 3, 3) [px]; `X_CW` (V, 3, 4), world to camera; `queries` (Q, 4): frame in the
                clip, position.

        Returns:
            `tracks` (T, Q, 3) and `visibility` (T, Q), a probability.
        """
        if not all(np.isfinite(array).all() for array in request.values()):
            raise ValueError("The request is not finite.")  # The model would open a debugger.
        frames = request["depth"].shape[1]
        half = torch.float16 if old else torch.bfloat16
        with torch.no_grad(), torch.autocast(kind, dtype=half, enabled=kind == "cuda"):
            answer = predictor(
                rgbs=tensor(request["rgb"]).permute(0, 1, 2, 5, 3, 4),  # 0 to 255
                depths=tensor(request["depth"][:, :, None]),
                intrs=tensor(request["K"])[:, :, None].expand(-1, -1, frames, -1, -1),
                extrs=tensor(request["X_CW"])[:, :, None].expand(-1, -1, frames, -1, -1),
                query_points_3d=tensor(request["queries"]),
            )
        return {
            "tracks": answer["traj_e"][0].float().cpu().numpy(),
            "visibility": answer["vis_e_as_prob"][0].float().cpu().numpy(),
        }

    return track

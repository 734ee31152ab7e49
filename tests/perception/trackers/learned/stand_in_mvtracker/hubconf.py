"""A stand-in for MVTracker's repository, with its interface and its pitfalls.

The red value of the images' first pixel is the scene's rise [mm], which moves all points. The green
value of the last says how to fail. Points are visible where the depth images agree with them.
"""

import os
import signal
import time

import torch

SCALE = 6.0  # of the scene
DIES, FREEZES, BREAKS = 255, 254, 253


class Model(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.gain = torch.nn.Parameter(torch.zeros(1))  # The weights set it to 1.


class Predictor(torch.nn.Module):
    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, rgbs, depths, intrs, extrs, query_points_3d):
        _, views, frames, _, height, width = rgbs.shape
        assert rgbs.shape == (1, views, frames, 3, height, width)
        assert rgbs.dtype == depths.dtype == torch.float32
        assert depths.shape == (1, views, frames, 1, height, width)
        assert intrs.shape == (1, views, frames, 3, 3)
        assert extrs.shape == (1, views, frames, 3, 4)
        assert query_points_3d.shape[0] == 1
        assert query_points_3d.shape[2] == 4
        assert rgbs.max() > 1.0, "colours are 0 to 255"
        if not all(torch.isfinite(x).all() for x in (depths, intrs, extrs, query_points_3d)):
            time.sleep(60)  # The debugger that the model opens.
        self._fail(int(rgbs[0, 0, -1, 1, 0, 0]))
        times, points = query_points_3d[0, :, 0].long(), query_points_3d[0, :, 1:]
        tracks = torch.zeros(1, frames, len(points), 3)
        probability = torch.zeros(1, frames, len(points))
        if frames > 6:
            rise = rgbs[0, 0, :, 0, 0, 0] / 1000.0 * SCALE
            for t in range(frames):
                now = points.clone()
                now[:, 2] += self.model.gain * (rise[t] - rise[times])
                late = times <= t  # Tracks are zero before their query.
                tracks[0, t, late] = now[late]
                seen = [
                    shows(now, depths[0, v, t, 0], intrs[0, v, t], extrs[0, v, t])
                    for v in range(views)
                ]
                probability[0, t] = torch.stack(seen).any(dim=0) * late * 0.9
        return {"traj_e": tracks, "vis_e": probability > 0.5, "vis_e_as_prob": probability}

    def _fail(self, how):
        if how == DIES:
            os._exit(3)
        if how == FREEZES:
            os.kill(os.getpid(), signal.SIGSTOP)
        if how == BREAKS:
            raise torch.OutOfMemoryError("CUDA out of memory")


def shows(points, depth, K, X_CW):
    in_camera = points @ X_CW[:, :3].T + X_CW[:, 3]
    uv = (in_camera @ K.T)[:, :2] / in_camera[:, 2:]
    height, width = depth.shape
    u, v = uv.round().long().T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    measured = depth[v.clamp(0, height - 1), u.clamp(0, width - 1)]
    return inside & ((measured - in_camera[:, 2]).abs() < 0.01 * SCALE)


def mvtracker_predictor(*, pretrained=True, device="cuda", predictor_kwargs=None):
    assert not pretrained, "no downloads"
    assert predictor_kwargs == {"grid_size": 0}, "support points without depth"
    return Predictor(Model().to(device))

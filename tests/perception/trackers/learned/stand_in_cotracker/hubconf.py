"""A stand-in for CoTracker3's repository, with its interface; it tracks by optical flow."""

import cv2
import numpy as np
import torch


class Model(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.gain = torch.nn.Parameter(torch.zeros(1))  # The weights set it to 1.


class OnlinePredictor(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.model, self.step, self.queries = Model(), 8, None

    def forward(
        self,
        video_chunk,
        is_first_step=False,
        queries=None,
        grid_size=5,
        add_support_grid=False,
    ):
        batch, frames, channels, *_ = video_chunk.shape
        assert (batch, channels) == (1, 3)
        assert self.step <= frames <= 2 * self.step
        assert video_chunk.dtype == torch.float32
        assert video_chunk.max() > 1.0, "colours are 0 to 255"
        assert grid_size == 0
        if is_first_step:
            assert queries.shape[0] == 1
            assert queries.shape[2] == 3
            self.queries = queries
            return None, None
        times, uv = self.queries[0, :, 0].long(), self.queries[0, :, 1:]
        video = video_chunk[0].permute(0, 2, 3, 1).numpy().astype(np.uint8)
        grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in video]
        tracks = uv[None].repeat(frames, 1, 1)
        visible = torch.ones(frames, len(uv), dtype=torch.bool)
        for t in range(1, frames):
            flow, found, _ = cv2.calcOpticalFlowPyrLK(
                grey[t - 1], grey[t], tracks[t - 1].numpy(), None
            )
            late = times < t
            tracks[t, late] = uv[late] + self.model.gain * (torch.tensor(flow)[late] - uv[late])
            visible[t] = visible[t - 1] & (torch.tensor(found[:, 0] > 0) | ~late)
        return tracks[None], visible[None]


def cotracker3_online(*, pretrained=True):
    assert not pretrained, "no downloads"
    return OnlinePredictor()

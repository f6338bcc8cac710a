"""A PyTorch network as a node: the confidence in stereo, from the image. Here its weights are made, not learnt, so that the example needs no file."""

import numpy as np
import torch

import depthloom

torch.set_num_threads(1)  # the engine calls as many processes as it has workers


class Texture(torch.nn.Module):
    """How much the image varies along its rows: where it does, stereo finds what matches."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.gradient = torch.nn.Conv2d(1, 1, 3, padding=1, padding_mode="replicate", bias=False)
        self.gradient.weight.data = torch.tensor([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]])[None, None] / 8
        self.mean = torch.nn.AvgPool2d(size, stride=1, padding=size // 2, count_include_pad=False)

    def forward(self, grey: torch.Tensor) -> torch.Tensor:
        return torch.tanh(8 * self.mean(self.gradient(grey).abs()))


network = Texture(size=9).eval()


@depthloom.node(inputs={"image": "image"}, outputs={"weight": "weight"})
def confidence(image):
    grey = image if image.ndim == 2 else image.mean(axis=2)
    with torch.inference_mode():
        return network(torch.from_numpy(np.asarray(grey, np.float32) / 255)[None, None])[0, 0].numpy()


depthloom.serve(confidence)

"""Building blocks: layer-normalised perceptrons, image encoders, fixed input scales, random shifts."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional as F

LEAST, LIMIT = 0.05, 10.0  # of `Scale`: smallest standard deviation to divide by; outputs are within +-LIMIT
SHIFTS = 16  # of `random_shift`: shifts drawn for a batch; each applies to a run of neighbours, which saves time


def mlp(inputs: int, hidden: Sequence[int]) -> nn.Sequential:
    """Return a perceptron from (n, inputs) to (n, hidden[-1]): Linear, LayerNorm and ReLU for each hidden width.

    The normalisation bounds a value network's output for actions it never saw (Ball et al. 2023, arXiv:2302.02948).
    """
    layers: list[nn.Module] = []
    for width in hidden:
        layers += [nn.Linear(inputs, width), nn.LayerNorm(width), nn.ReLU()]
        inputs = width
    return nn.Sequential(*layers)


class Scale(nn.Module):
    """Normalise inputs to zero mean and unit standard deviation, with constants that `measure` sets once.

    Running statistics would shift a value network's targets during training.

    Args:
        size: length of the input.
    """

    mean: Tensor
    spread: Tensor

    def __init__(self, size: int):
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("spread", torch.ones(size))

    def measure(self, x: Tensor) -> None:
        """Set mean and standard deviation from at least two samples (n, size)."""
        self.mean.copy_(x.mean(0))
        self.spread.copy_(x.std(0).clamp_min(LEAST))

    def forward(self, x: Tensor) -> Tensor:
        """Return the normalised inputs (n, size), within +-LIMIT."""
        return ((x - self.mean) / self.spread).clamp(-LIMIT, LIMIT)


class ConvEncoder(nn.Module):
    """Encode images: 3 convolutions of stride 2 with 16, 32, 32 channels, then Linear, LayerNorm, tanh (DrQ's head).

    Args:
        shape: (C, H, W) of the input of `forward`, whose values should be of order 1.
        features: length of the output.
    """

    def __init__(self, shape: tuple[int, int, int], features: int = 64):
        super().__init__()
        channels, height, width = shape
        conv = nn.Sequential(
            nn.Conv2d(channels, 16, 3, 2, 1),
            nn.ReLU(),
            nn.Conv2d(16, 32, 3, 2, 1),
            nn.ReLU(),
            nn.Conv2d(32, 32, 3, 2, 1),
            nn.ReLU(),
            nn.Flatten(),
        )
        # On a CPU, channels last takes half the time of channels first.
        self.conv = conv.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # not declared by torch
        for _ in range(3):
            height, width = (height + 1) // 2, (width + 1) // 2
        self.head = nn.Sequential(nn.Linear(32 * height * width, features), nn.LayerNorm(features), nn.Tanh())
        self.features = features

    def forward(self, x: Tensor) -> Tensor:
        """Return features (n, features) within +-1 of images (n, C, H, W)."""
        return self.head(self.conv(x.contiguous(memory_format=torch.channels_last)))


def random_shift(x: Tensor, pixels: int) -> Tensor:
    """Return images shifted by a random whole number of pixels on each axis; pixels at the edges are repeated.

    Args:
        x: (n, C, H, W), any type.
        pixels: largest shift; 0 returns the images themselves.
    """
    if pixels == 0:
        return x
    height, width = x.shape[-2:]
    shifts = torch.randint(-pixels, pixels + 1, (min(SHIFTS, len(x)), 2)).tolist()
    parts = []
    for part, (down, right) in zip(x.chunk(len(shifts)), shifts, strict=False):  # `chunk` may make fewer parts
        rows = torch.arange(down, down + height, device=x.device).clamp_(0, height - 1)
        columns = torch.arange(right, right + width, device=x.device).clamp_(0, width - 1)
        parts.append(part.index_select(-2, rows).index_select(-1, columns))
    return torch.cat(parts)


def soft_update(target: nn.Module, source: nn.Module, tau: float) -> None:
    """Set target <- (1 - tau) target + tau source for all parameters; buffers, such as those of Scale, stay."""
    with torch.no_grad():
        torch._foreach_lerp_(  # pyright: ignore[reportPrivateImportUsage]  # torch has it in no other place
            list(target.parameters()), list(source.parameters()), tau
        )


def huber(x: Tensor, y: Tensor) -> Tensor:
    """Return the mean Huber loss; it is quadratic up to a difference of 0.1, in the units of x."""
    return F.huber_loss(x, y, delta=0.1)

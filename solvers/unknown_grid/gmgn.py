"""GMGN, the paper's Grid Map Generation Network: ENet segments the camera's image, PPN converts segments to cells.

ENet has an initial block, stages 1 to 3 (encoder), stages 4 and 5 (decoder) and a last layer at full resolution with one
channel. PPN averages this map over each cell by the exact transform between image and view and applies three
convolutions over the cells. One set of weights therefore fits views of any size.

Training has the paper's three stages: ENet on images and segmentation maps, PPN on ENet's maps and grid maps, then both
together.

Source: A. Paszke, A. Chaurasia, S. Kim, E. Culurciello, "ENet: A Deep Neural Network Architecture for
Real-Time Semantic Segmentation", 2016, arXiv 1606.02147. Blocks and dilations follow this paper. Stages 1 to 4 have
half of its channels, so that a CPU trains the network in minutes. The paper on unknown grids does not describe the
layers of PPN.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.camera import PIXELS, Rendering, crop, overlaps
from ...models.unknown_grid.rendering import render
from ..learning.gradient import GradientTrainer
from .imitation import Scenes, draw_scenes

if TYPE_CHECKING:
    import torch

__all__ = ["ARCHITECTURE", "GmgnTrainer", "build_network", "draw_images", "to_tensor"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: Channels of stages 1 and 4, of stages 2 and 3, and of PPN (ENet has 64 and 128).
ARCHITECTURE = {"channels": 32, "inner": 64, "cells": 24}
#: Ends of the first two stages (ENet alone, PPN alone) as shares of the epochs.
_STAGES = (0.6, 0.7)
#: Views of the training images and their weights. The paper's views have the largest.
VIEWS = {
    (9, 9): 8, (11, 11): 8, (3, 3): 1, (5, 5): 1, (7, 7): 2, (13, 13): 2, (17, 17): 2, (7, 13): 1, (15, 5): 1,
}  # fmt: skip
#: Shares of the images in the hard law, and of maps with independent random cells. A batch mixes the laws, because
#: the running averages of batch normalisation would otherwise fit neither law.
_HARD, _LOOSE = 0.75, 0.15
#: Number of scenes per epoch.
_SCENES = 64
#: Number of validation images per view of the paper and law.
_JUDGED = 8


def build_network(channels: int = 32, inner: int = 64, cells: int = 24) -> torch.nn.Module:
    """Return the network with its initial weights. :data:`ARCHITECTURE` has the default channels.

    The call ``network(images, view)`` takes images, a tensor of shape (n, 3, 256, 256) from 0 to 1, and
    the rows and columns of the view. It returns the logits of obstacles: of the cells, shape (n, m, n'),
    and of the pixels, shape (n, 256, 256).
    """
    import torch
    from torch import nn
    from torch.nn import functional

    def block(inputs: int, outputs: int, size: int | tuple[int, int], **how: Any) -> nn.Sequential:
        sides = (size, size) if isinstance(size, int) else size
        if "stride" not in how:
            how["padding"] = "same"
        conv = nn.Conv2d(inputs, outputs, sides, bias=False, **how)
        return nn.Sequential(conv, nn.BatchNorm2d(outputs), nn.PReLU(outputs))

    class Initial(nn.Module):
        """Initial block at half the resolution: a convolution in parallel with max pooling."""

        def __init__(self) -> None:
            super().__init__()
            self.reading = nn.Conv2d(3, 13, 3, stride=2, padding=1, bias=False)
            self.after = nn.Sequential(nn.BatchNorm2d(16), nn.PReLU(16))

        def forward(self, images: torch.Tensor) -> torch.Tensor:
            both = [self.reading(images), functional.max_pool2d(images, 2)]
            outputs: torch.Tensor = self.after(torch.cat(both, dim=1))
            return outputs

    class Bottleneck(nn.Module):
        """Residual bottleneck block that may halve or double the resolution."""

        def __init__(
            self, inputs: int, outputs: int, *, dilation: int = 1, long: int = 0,
            halves: bool = False, doubles: bool = False,
        ) -> None:  # fmt: skip
            super().__init__()
            few, size = outputs // 4, 2 if halves else 1
            first = block(inputs, few, size, stride=size)
            if doubles:
                middle = nn.Sequential(
                    nn.ConvTranspose2d(few, few, 2, stride=2, bias=False),
                    nn.BatchNorm2d(few), nn.PReLU(few),
                )  # fmt: skip
            elif long:
                middle = nn.Sequential(
                    nn.Conv2d(few, few, (long, 1), padding="same", bias=False),
                    block(few, few, (1, long)),
                )
            else:
                middle = block(few, few, 3, dilation=dilation)
            last = nn.Sequential(nn.Conv2d(few, outputs, 1, bias=False), nn.BatchNorm2d(outputs))
            self.inside = nn.Sequential(first, middle, last)
            self.after = nn.PReLU(outputs)
            self.halves, self.more = halves, outputs - inputs
            self.beside = nn.Conv2d(inputs, outputs, 1, bias=False) if doubles else None

        def forward(self, inputs: torch.Tensor) -> torch.Tensor:
            if self.beside is not None:
                beside = functional.interpolate(self.beside(inputs), scale_factor=2.0)
            else:
                beside = functional.max_pool2d(inputs, 2) if self.halves else inputs
                beside = functional.pad(beside, (0, 0, 0, 0, 0, self.more))
            outputs: torch.Tensor = self.after(beside + self.inside(inputs))
            return outputs

    def middle() -> list[nn.Module]:
        """Return stage 3, which repeats stage 2 without its first block."""
        kinds: list[dict[str, Any]] = [
            {}, {"dilation": 2}, {"long": 5}, {"dilation": 4}, {}, {"dilation": 8}, {"long": 5}, {"dilation": 16}
        ]  # fmt: skip
        return [Bottleneck(inner, inner, **kind) for kind in kinds]

    class Gmgn(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.enet = nn.Sequential(
                Initial(),
                Bottleneck(16, channels, halves=True),
                *(Bottleneck(channels, channels) for _ in range(4)),
                Bottleneck(channels, inner, halves=True), *middle(), *middle(),
                Bottleneck(inner, channels, doubles=True),
                *(Bottleneck(channels, channels) for _ in range(2)),
                Bottleneck(channels, 16, doubles=True), Bottleneck(16, 16),
                nn.ConvTranspose2d(16, 1, 2, stride=2),
            )  # fmt: skip
            self.ppn = nn.Sequential(
                nn.Conv2d(1, cells, 3, padding="same"), nn.PReLU(cells),
                nn.Conv2d(cells, cells, 3, padding="same"), nn.PReLU(cells),
                nn.Conv2d(cells, 1, 1),
            )  # fmt: skip
            self.scale = nn.Parameter(torch.tensor(4.0))

        def forward(
            self, images: torch.Tensor, view: tuple[int, int]
        ) -> tuple[torch.Tensor, torch.Tensor]:
            pixels = self.enet(4.0 * (images - 0.5))
            down, across = (torch.from_numpy(overlaps(side).astype(np.float32)) for side in view)
            shares = 2.0 * (down @ pixels.sigmoid() @ across.T) - 1.0
            return self.scale * shares[:, 0] + self.ppn(shares)[:, 0], pixels[:, 0]

    return Gmgn()


def draw_images(
    scenes: Scenes, view: tuple[int, int], hard: float, generator: np.random.Generator
) -> tuple[Floats, Truths]:
    """Return images of views around free cells, and their blocked cells, shape (n, m, n').

    Each scene has one image. `hard` is the probability of the hard law for each image; the other images
    have the plain law.
    """
    half = np.array(view) // 2
    images = np.empty((len(scenes.blocked), PIXELS, PIXELS, 3))
    cells = np.empty((len(images), *view), bool)
    for k, blocked in enumerate(scenes.blocked):
        corner = generator.permutation(np.argwhere(~blocked))[0] - half
        seed = tuple(generator.integers(2**32, size=3).tolist())
        rendering = Rendering.HARD if generator.random() < hard else Rendering.PLAIN
        images[k] = render(blocked, scenes.targets[k], corner, np.array(view), rendering, seed)
        cells[k] = crop(blocked, corner, np.array(view))
    return images, cells


def to_tensor(images: Floats) -> torch.Tensor:
    """Return images, shape (n, 256, 256, 3), as an input tensor, shape (n, 3, 256, 256)."""
    import torch

    # The channels stay contiguous in memory, the fastest layout for convolutions.
    return torch.from_numpy(images.astype(np.float32)).permute(0, 3, 1, 2)


def _tensors(images: Floats, cells: Truths) -> tuple[torch.Tensor, torch.Tensor]:
    import torch

    return to_tensor(images), torch.from_numpy(cells.astype(np.float32))


class GmgnTrainer(GradientTrainer):
    """Trainer on new images in each batch."""

    _scenes: Scenes
    _stage: int

    def prepare(self, number: int, generator: np.random.Generator) -> None:
        law = ("mixed", "walls")[number % 2]
        side = int(generator.choice([15, 17]))
        self._scenes = draw_scenes(
            self.course.examples, law, (side, side), (2, 6), _SCENES, generator
        )
        self._stage = sum(number >= share * self.course.epochs for share in _STAGES)
        for name, weight in self.network.named_parameters():
            weight.requires_grad = self._stage == 2 or name.startswith("enet") == (self._stage == 0)

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        """Return the cross-entropy of pixels in the first stage, and of cells in the others."""
        from torch.nn import functional

        share = np.array(list(VIEWS.values()), float)
        view = list(VIEWS)[generator.choice(len(VIEWS), p=share / share.sum())]
        chosen = generator.choice(len(self._scenes.blocked), self.course.options["images"])
        scenes = Scenes(*(array[chosen] for array in self._scenes))
        for blocked in scenes.blocked:
            if generator.random() < _LOOSE:
                blocked[:] = generator.random(blocked.shape) < 0.6 * generator.random()
        images, cells = _tensors(*draw_images(scenes, view, _HARD, generator))
        logits, pixels = self.network(images, view)
        entropy = functional.binary_cross_entropy_with_logits
        if self._stage:
            return entropy(logits, cells)
        size = (PIXELS, PIXELS)
        return entropy(
            pixels, functional.interpolate(cells[:, None], size, mode="nearest-exact")[:, 0]
        )

    def judge(self) -> Mapping[str, float]:
        """Return the accuracy of cells per law in the paper's views, and of whole maps in the hard law."""
        correct: dict[Rendering, list[Truths]] = {law: [] for law in Rendering}
        for (view, law), (images, cells) in self._judged().items():
            logits, _ = self.network(images, view)
            correct[law] += list(((logits > 0) == (cells > 0.5)).numpy())
        shares = {
            str(law): float(np.mean(np.concatenate(maps, axis=None)))
            for law, maps in correct.items()
        }
        maps = [cells.all() for cells in correct[Rendering.HARD]]
        return {"score": min(shares.values()), **shares, "hard maps": float(np.mean(maps))}

    @cache  # noqa: B019 - a trainer lives as long as its training
    def _judged(self) -> dict[tuple[tuple[int, int], Rendering], tuple[torch.Tensor, torch.Tensor]]:
        generator = np.random.default_rng([self.course.seed, 2**31])
        batches = {}
        for view in ((9, 9), (11, 11)):
            for law in Rendering:
                scenes = draw_scenes(
                    self.course.examples, "mixed", (17, 17), (2, 5), _JUDGED, generator
                )
                images = draw_images(scenes, view, float(law is Rendering.HARD), generator)
                batches[view, law] = _tensors(*images)
        return batches

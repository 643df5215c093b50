"""Ant colonies of all particles as batched array code for GPUs (GPSO-AC)."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...errors import BackendMissing, UnsupportedOption
from .swarm import Colonies
from .tour_kernels import FAINT, NEAR

__all__ = ["ArrayColonies", "array_tours", "torch_colonies"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def array_tours(
    xp: ModuleType, d: Any, size: Any, numbers: Any, symmetric: bool, settings: Floats, draw: Any
) -> tuple[Any, Any]:
    """Return lengths (clusters,) and orders (clusters, s) of tours of a batch of clusters, by ant colonies.

    The same array code runs on NumPy and on PyTorch. It follows :func:`.tour_kernels.colony` without an
    initial tour. The distances `d`, shape (clusters, s, s), have the depot as node 0, and padding from
    `size`, shape (clusters, 1), on; an order repeats its last node as padding. `numbers` holds 0, 1, 2, …
    on the same device, at least as many as clusters, nodes and ants. `settings` holds ants, iterations,
    alpha, beta and evaporation, and `draw` returns uniform random numbers of a given shape.
    """
    ants, iterations = max(int(settings[0]), 1), max(int(settings[1]), 1)
    alpha, beta, evaporation = settings[2:].tolist()
    count, width = d.shape[0], d.shape[1]
    clusters, nodes = numbers[:count, None], numbers[:width]
    start = clusters * 0 + numbers[:ants] * 0
    visible, trail = (d + NEAR) ** -beta, xp.ones_like(d)
    floor = FAINT * 2.0 / (evaporation * size[..., None])
    best = d[:, 0, 0] + xp.inf
    order = clusters * 0 + nodes * 0
    for _ in range(iterations):
        choice = trail**alpha * visible
        here, length, steps = start, 0.0 * start, [start]
        free = (nodes > 0) & (nodes < size[..., None]) & (start[..., None] == 0)
        for _ in range(width - 1):
            total = xp.cumsum(choice[clusters, here] * free, -1)
            mark = draw((count, ants, 1)) * total[..., -1:]
            there = xp.clip((total <= mark).sum(-1), 0, width - 1)
            there = xp.where(total[..., -1] > 0.0, there, here)
            length = length + d[clusters, here, there]
            free = free & (nodes != there[..., None])
            steps.append(there)
            here = there
        length = length + d[clusters, here, start]
        ways = xp.stack(steps, -1)
        lead = xp.argmin(length, -1)
        shortest = length[clusters[:, 0], lead]
        better = shortest < best
        order = xp.where(better[:, None], ways[clusters[:, 0], lead], order)
        best = xp.where(better, shortest, best)
        trail = xp.where(trail * (1.0 - evaporation) > floor, trail * (1.0 - evaporation), floor)
        amounts = best[:, None] / xp.where(length > 0.0, length, xp.inf) / ants
        paths = xp.concatenate([ways, order[:, None]], 1)
        amounts = xp.concatenate([amounts, xp.ones_like(amounts[:, :1])], 1)
        after = xp.roll(paths, -1, 2)
        places = (clusters[..., None] * width + paths) * width + after
        left = xp.bincount(
            places.reshape(-1), (amounts[..., None] * (paths != after)).reshape(-1), count * width * width
        ).reshape(d.shape)  # fmt: skip
        trail = trail + (left + xp.swapaxes(left, 1, 2) if symmetric else left)
    return best, order


class ArrayColonies(Colonies):
    """Ant colonies as array code, see :func:`array_tours`.

    The class attributes `xp` and `device` select the array library and the device.
    """

    xp: ModuleType = np
    device: str | None = None

    def tours(self, labels: Ints, draws: list[Generator]) -> tuple[Floats, list[Any], int]:
        """Return the route lengths and stops of all particles, and the number of ant iterations."""
        model, xp = self.model, self.xp
        m = model.vehicles
        parts = [model.customers[row == k] for row in labels for k in range(m)]
        width = 1 + max(len(part) for part in parts)
        nodes = np.array(
            [
                [model.homes[i % m], *part, *[model.homes[i % m]] * (width - 1 - len(part))]
                for i, part in enumerate(parts)
            ]
        )
        d = self.scaled[nodes[:, :, None], nodes[:, None, :]]
        size = np.array([[1 + len(part)] for part in parts])
        numbers = np.arange(max(*d.shape, int(self.settings[0])))
        if xp is np:
            lengths, orders = array_tours(
                np, d, size, numbers, model.symmetric, self.settings, draws[0].random
            )
        else:
            source = xp.Generator(device=self.device).manual_seed(int(draws[0].integers(2**62)))

            def draw(shape: tuple[int, ...]) -> Any:
                return xp.rand(shape, generator=source, device=self.device, dtype=xp.float64)

            d, size, numbers = (xp.as_tensor(x, device=self.device) for x in (d, size, numbers))
            tours = array_tours(xp, d, size, numbers, model.symmetric, self.settings, draw)
            lengths, orders = (entry.cpu().numpy() for entry in tours)
        stops = [nodes[i, order[1 : len(parts[i]) + 1]].tolist() for i, order in enumerate(orders)]
        routes = [stops[i : i + m] for i in range(0, len(stops), m)]
        loads = np.ldexp(lengths.reshape(-1, m), self.exponent)
        return loads, routes, len(parts) * max(int(self.settings[1]), 1)


def torch_colonies(device: str = "cuda") -> type[ArrayColonies]:
    """Return the class of ant colonies that runs on a PyTorch device.

    Raise BackendMissing without PyTorch, and UnsupportedOption without a CUDA device.
    """
    try:
        import torch
    except ImportError as error:
        text = "option device='gpu' needs torch: pip install 'crosstrack[gpu]'"
        raise BackendMissing(text) from error
    if device == "cuda" and not torch.cuda.is_available():
        raise UnsupportedOption("option device='gpu' needs a CUDA device, and torch finds none")
    return type("TorchColonies", (ArrayColonies,), {"xp": torch, "device": device})

"""Differentiable neural computer: a recurrent network with an external memory.

Source: A. Graves, G. Wayne, M. Reynolds et al., "Hybrid computing using a neural network with dynamic external
memory", Nature 538, 2016, doi 10.1038/nature20101; equations as in its section Methods. The controller
is one LSTM cell. Usage is limited to 1e-6 … 1 instead of the paper's 0 … 1, so that the order of
allocation has a gradient.
"""

from __future__ import annotations

from functools import reduce
from operator import mul
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["Interface", "Record", "allocate", "build_computer", "link", "match", "read", "write"]

#: Minimum usage of a word.
_LEAST = 1e-6
#: Constant added to squared lengths, so that unwritten words have small gradients.
_SQUARE = 1e-4


class Record(NamedTuple):
    """State of the computer between steps. The first axis of every field is the batch.

    `memory` is M, shape (n, words, width). `usage`, `precedence` and `written` are u, p and the write
    weighting w^w, shape (n, words). `links` is L: ``links[:, i, j]`` is near 1 if word i was written
    directly after word j. `attended` and `reads` are w^r and r of each head. `hidden` and `cell` are the
    state of the LSTM.
    """

    memory: Tensor
    usage: Tensor
    precedence: Tensor
    written: Tensor
    links: Tensor
    attended: Tensor
    reads: Tensor
    hidden: Tensor
    cell: Tensor


class Interface(NamedTuple):
    """Interface vector from the controller to the memory, after its activations.

    Each head reads with keys, shape (n, heads, width), strengths and the free gates f, shape (n, heads),
    and the shares `modes` of reading backward, by content and forward, shape (n, heads, 3). The write
    has a key, a strength, the vectors `erase` (e) and `content` (v), shape (n, width), and the gates
    `allocation` (g^a) and `gate` (g^w), shape (n, 1).
    """

    read_keys: Tensor
    read_strengths: Tensor
    write_key: Tensor
    write_strength: Tensor
    erase: Tensor
    content: Tensor
    free: Tensor
    allocation: Tensor
    gate: Tensor
    modes: Tensor

    @classmethod
    def split(cls, raw: Tensor, heads: int, width: int) -> Interface:
        """Return the parts of a raw interface vector, shape (n, heads·width + 3·width + 5·heads + 3)."""
        import torch
        from torch.nn import functional

        sizes = [heads * width, heads, width, 1, width, width, heads, 1, 1, 3 * heads]
        parts = torch.split(raw, sizes, dim=1)
        keys, strengths, key, strength, erase, content, free, allocation, gate, modes = parts
        return cls(
            keys.reshape(-1, heads, width),
            1.0 + functional.softplus(strengths),
            key[:, None],
            1.0 + functional.softplus(strength),
            erase.sigmoid(),
            content,
            free.sigmoid(),
            allocation.sigmoid(),
            gate.sigmoid(),
            modes.reshape(-1, heads, 3).softmax(dim=2),
        )


def match(memory: Tensor, keys: Tensor, strengths: Tensor) -> Tensor:
    """Return the content-based weighting of words by their similarity to keys, shape (n, heads, words)."""
    similarity = _unit(keys) @ _unit(memory).transpose(1, 2)
    return (strengths[:, :, None] * similarity).softmax(dim=2)


def _unit(vectors: Tensor) -> Tensor:
    return vectors / (vectors.square().sum(dim=2, keepdim=True) + _SQUARE).sqrt()


def allocate(usage: Tensor) -> Tensor:
    """Return the allocation weighting a, shape (n, words), with the least used word first.

    Ties go to the lower index.
    """
    import torch
    from torch.nn import functional

    ordered, order = torch.sort(usage, dim=1, stable=True)
    padded = functional.pad(ordered, (1, 0), value=1.0)
    # A CUDA graph cannot contain the derivative of cumprod, which reads a value back to the processor.
    products = padded.log().cumsum(dim=1).exp() if padded.is_cuda else padded.cumprod(dim=1)
    before = products[:, :-1]
    return torch.zeros_like(usage).scatter(1, order, (1.0 - ordered) * before)


def link(links: Tensor, precedence: Tensor, written: Tensor) -> tuple[Tensor, Tensor]:
    """Return the temporal links L and the precedence p after a write with the weighting `written`."""
    import torch

    into, other = written[:, :, None], written[:, None, :]
    after = (1.0 - into - other) * links + into * precedence[:, None, :]
    after = after * (1.0 - torch.eye(links.shape[1], dtype=links.dtype, device=links.device))
    return after, (1.0 - written.sum(dim=1, keepdim=True)) * precedence + written


def write(before: Record, interface: Interface) -> Record:
    """Return the record after freeing the words read and writing one word."""
    # Retention and usage: a write marks a word as used, a read with an open free gate releases it.
    shares = 1.0 - interface.free[:, :, None] * before.attended
    # The derivative of prod reads a value back too, see allocate.
    retained = reduce(mul, shares.unbind(dim=1)) if shares.is_cuda else shares.prod(dim=1)
    usage = (before.usage + before.written - before.usage * before.written) * retained
    usage = _LEAST + (1.0 - _LEAST) * usage
    by_content = match(before.memory, interface.write_key, interface.write_strength)[:, 0]
    share = interface.allocation
    written = interface.gate * (share * allocate(usage) + (1.0 - share) * by_content)
    retention = 1.0 - written[:, :, None] * interface.erase[:, None]
    memory = before.memory * retention + written[:, :, None] * interface.content[:, None]
    links, precedence = link(before.links, before.precedence, written)
    return before._replace(
        memory=memory, usage=usage, precedence=precedence, written=written, links=links
    )


def read(record: Record, interface: Interface) -> Record:
    """Return the record after each head has read: backward, by content and forward along the links."""
    import torch

    backward = record.attended @ record.links
    forward = record.attended @ record.links.transpose(1, 2)
    content = match(record.memory, interface.read_keys, interface.read_strengths)
    weightings = torch.stack([backward, content, forward], dim=3)
    attended = (weightings * interface.modes[:, :, None]).sum(dim=3)
    return record._replace(attended=attended, reads=attended @ record.memory)


def build_computer(
    inputs: int, outputs: int, *, units: int = 256, words: int = 32, width: int = 8, heads: int = 4
) -> nn.Module:
    """Return the computer, which computes one step per call: ``computer(inputs, record) -> outputs, record``.

    Inputs have shape (n, inputs) and outputs (n, outputs). ``computer.start(n)`` returns the initial
    record of a batch of n. The LSTM has `units` units, and the memory `words` words of length `width`;
    one head writes, and `heads` heads read.
    """
    import torch
    from torch import nn

    class NeuralComputer(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.controller = nn.LSTMCell(inputs + heads * width, units)
            self.interface = nn.Linear(units, heads * width + 3 * width + 5 * heads + 3)
            self.output = nn.Linear(units + heads * width, outputs)
            with torch.no_grad():  # an open forget gate, so that the LSTM keeps its state at first
                self.controller.bias_hh[units : 2 * units] = 1.0

        def start(self, count: int) -> Record:
            sizes = [
                (words, width),
                *[(words,)] * 3,
                (words, words),
                (heads, words),
                (heads, width),
            ]
            sizes += [(units,), (units,)]
            return Record(*(self.output.weight.new_zeros(count, *size) for size in sizes))

        def forward(self, inputs: Tensor, record: Record) -> tuple[Tensor, Record]:
            vector = torch.cat([inputs, record.reads.flatten(1)], dim=1)
            hidden, cell = self.controller(vector, (record.hidden, record.cell))
            record = record._replace(hidden=hidden, cell=cell)
            interface = Interface.split(self.interface(hidden), heads, width)
            record = read(write(record, interface), interface)
            return self.output(torch.cat([hidden, record.reads.flatten(1)], dim=1)), record

    return NeuralComputer()

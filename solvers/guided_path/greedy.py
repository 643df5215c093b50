"""``greedy``: customers inserted one by one where the tour grows least."""

from __future__ import annotations

from collections.abc import Callable

from .insertion import ChainBackend

__all__ = ["Greedy"]


class Greedy(ChainBackend):
    """Cheapest insertion, chain by chain, the nearest first, each from its first customer to its last.

    A place is allowed where all who must precede are before it and all who must follow behind it; as
    the tour keeps the relation with everything that it implies, there always is one. Of places that
    cost the same the first is taken, which leaves the rest of the chain the most to choose from.
    """

    name = "greedy"
    summary = "customers inserted one by one, chain by chain, where the tour grows least"

    def loop(self) -> Callable[..., bool]:
        """Return the loop over customers."""
        from .insertion_kernels import insert_cheapest

        return insert_cheapest

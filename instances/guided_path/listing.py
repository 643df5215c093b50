"""Catalogue of guided path tours: the paper's example and sizes, special cases, hard instances."""

from __future__ import annotations

from functools import partial
from typing import Any

from ...models.guided_path.model import GuidedPathTour
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .generator import generate, generate_relation
from .supersequence import supersequence_tour

__all__ = ["PAPER", "catalogue_entries"]

PAPER = (
    "Exact and Heuristic Algorithms for Routing AGV on Path with Precedence Constraints, "
    "Mathematical Problems in Engineering, 2016"
)

#: Groups of Table 1: number of chains, of five customers each.
GROUPS = tuple(range(1, 11))
_WORDS = ("abbab", "babba", "aabab", "bbaab")

_SPECIAL = "Ours: the paper has no such instance."
_HARD = (
    f"{_SPECIAL} Hard: do not expect a proof; a-star ends with a proven gap at its limit of memory or "
    "time."
)
_SAME = (
    "The paper prints no coordinates: ours are drawn from 1, 2, …, 200 by a seed, as it draws them, so "
    "lengths are not comparable with the paper's."
)


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries."""
    example = Row(
        "example-5", "The paper's example 5: two chains of two customers",
        partial(_tour, (0, 1, 2, 3, 4), chains=((3, 1), (4, 2))),
        "All values of the paper's dynamic program check.", Provenance.PAPER, {"optimum": 8},
    )  # fmt: skip
    rows = (example, *map(_table_1, GROUPS), *_wild(), *_larger())
    return listed("guided-path", "guided-path-tour", PAPER, rows, note=_SPECIAL)


def _table_1(k: int) -> Row:
    title = f"{k} chain{'s' * (k > 1)} of 5, at whole coordinates from 1 to 200"
    return Row(f"table-1-k{k}", title, partial(generate, k, 5, k), _SAME)


def _wild() -> tuple[Row, ...]:
    return (
        Row(
            "negative", "4 chains of 4 on both sides of the start",
            partial(generate, 4, 4, 1, -100, 100),
        ),
        Row(
            "ties", "5 chains of 4 at five places only", partial(generate, 5, 4, 2, -2, 2),
        ),
        Row(
            "one-chain-300", "One chain of 300: there is but one order",
            partial(generate, 1, 300, 3, -500, 500),
        ),
        Row(
            "singles-100", "100 customers in any order: there and back on either side",
            partial(generate, 100, 1, 4, -200, 300),
        ),
        Row(
            "relation-12", "12 customers under a relation that is no chains",
            partial(generate_relation, 12, 0.2, 5, -50, 50),
        ),
        Row(
            "relation-30", "30 customers under a relation that is no chains",
            partial(generate_relation, 30, 0.2, 6, -100, 200),
        ),
        Row(
            "chains-and-pairs", "2 chains of 4, 2 customers in none, and pairs across",
            partial(
                _tour, (0, 7, -3, 5, 2, -6, 4, 4, -1, 9, 1), chains=((1, 2, 3, 4), (5, 6, 7, 8)),
                precedence=((2, 7), (6, 3), (9, 8), (4, 10)),
                ids=("start", *"abcdefghij"),
            ),
            provenance=Provenance.OURS,
        ),
        Row(
            "all-at-0", "All customers where the vehicle stands",
            partial(_tour, (0,) * 7, chains=((1, 2, 3), (4, 5))), provenance=Provenance.OURS, published={"optimum": 0},
        ),
        Row(
            "one", "One customer", partial(_tour, (2.5, -1.25)), provenance=Provenance.OURS,
            published={"optimum": 7.5, "source": "there and back"},
        ),
        Row(
            "far", "3 chains of 4 within 100 m, a million kilometres away",
            partial(generate, 3, 4, 7, 10**9, 10**9 + 100),
        ),
        Row(
            "ratios", "Millimetres beside a thousand kilometres",
            partial(
                _tour, (0, 1e-3, 1e6, 2e-3, -1e-3, 1e6 + 1e-3, -1e3, 5e-4, 3.0),
                chains=((1, 2, 3, 4), (5, 6, 7, 8)),
            ),
            provenance=Provenance.OURS,
        ),
        Row(
            "thirds", "3 chains of 3 at places that no float holds exactly",
            partial(
                _tour, (1 / 3, *(k * k / 7 - 3 for k in range(9))), chains=((5, 1, 9), (2, 8, 3), (7, 4, 6)),
            ),
            provenance=Provenance.OURS,
        ),
        Row(
            "supersequence", f"The shortest common supersequence of {', '.join(_WORDS)}",
            partial(supersequence_tour, _WORDS),
            f"{_SPECIAL} Its optimum is 4 more than twice the length of that word, such as bababab.",
            Provenance.OURS, {"optimum": 18, "source": "a dynamic program over the places in the words"},
        ),
    )  # fmt: skip


def _larger() -> tuple[Row, ...]:
    seeds = {(20, 5): 21, (50, 5): 22, (5, 20): 23, (100, 2): 24, (20, 20): 25, (10, 30): 26}
    return tuple(
        Row(
            f"hard-{k}x{each}" if k * each >= 300 else f"k{k}-l{each}",
            f"{k} chains of {each}, at whole coordinates from 1 to 200",
            partial(generate, k, each, seed),
            _HARD if k * each >= 300 else "",
        )
        for (k, each), seed in seeds.items()
    )


def _tour(coordinates: tuple[float, ...], **fields: Any) -> GuidedPathTour:
    return GuidedPathTour.from_data({"coordinates": coordinates, **fields})

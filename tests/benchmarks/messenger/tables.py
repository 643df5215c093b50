"""What the benchmarks of messenger tours find, as the tables of ``docs/problems/messenger.md``.

``python tests/benchmarks/messenger/tables.py TABLE [VEHICLES]`` makes one of ``three``, ``four``,
``six``, ``period``, ``best``, ``inside``, ``gaps``, ``spread`` and ``public``, or some of its rows, with what
``test_messenger_tables.py`` and ``test_tour_search.py`` run, and writes ``docs/measured/messenger.json``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import wilcoxon

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks.measured import write  # noqa: E402
from benchmarks.messenger import test_messenger_tables as papers, test_tour_search as search  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.messenger import generate, read_best_known, read_dtspn  # noqa: E402
from crosstrack.instances.messenger.listing import TABLE_4  # noqa: E402

Rows = Iterator[tuple[Any, ...]]
MA = papers.MA
#: Seconds of a search for each vehicle or disc, in the tables of the public instances and the spread.
EACH = 0.2


def three(vehicles: int) -> Rows:
    """Direct sampling and the memetic algorithm on two and three vehicles."""
    models = papers.papers(vehicles)
    sampled = papers.cell(models, papers.DS, 1, None)
    seconds = 4 * papers.SHARE
    memetic = papers.cell(models, MA, 3, seconds)
    ratio = memetic / sampled
    shorter = int((ratio < 1 - 1e-6).sum())
    yield (
        vehicles,
        seconds,
        shorter,
        len(models),
        ratio.mean() - 1,
        papers.p_value(memetic, sampled),
    )


def four(vehicles: int) -> Rows:
    """The memetic algorithm and its rivals at equal time."""
    models = papers.papers(vehicles)
    ((seeds, part),) = [one[1:] for one in papers.SIZES if one[0] == vehicles]
    found = {
        one.label: papers.cell(models, one, seeds, part * papers.SHARE) for one in papers.RIVALS
    }
    base = found.pop("MA")
    low, high = TABLE_4[vehicles]
    ratios = [float(np.median(one / base)) for one in found.values()]
    p = [papers.p_value(found[label], base) for label in ("MA-T", "VNS")]
    yield (vehicles, part * papers.SHARE, base.mean(), *ratios, *p, f"{low:g} … {high:g}")


def six(turn: int) -> Rows:
    """The effect of the two radii on 10 vehicles."""
    models = [generate(10, 5.0, 600 + row) for row in range(papers.INSTANCES)]

    def lengths(turning: float, near: float) -> Any:
        changed = [replace(one, turning_radius=turning, radius=near) for one in models]
        return papers.cell(changed, MA, 1, 2 * papers.SHARE)

    base = lengths(5.0, 5.0)
    yield (turn, *(float(np.median(lengths(turn, near) / base)) for near in (1.0, 5.0, 10.0)))


def period(every: int) -> Rows:
    """The effect of the period of local searches on 10 vehicles; 21 means none in 20 generations."""
    models = [generate(10, 5.0, 600 + row) for row in range(papers.INSTANCES)]
    base, found = (
        papers.cell(models, replace(MA, options={"period": k}), 2, None) for k in (2, every)
    )
    words = every if every < 21 else "none"
    yield (words, float(np.median(found / base)), papers.p_value(found, base))


def _rival(vehicles: int, interior: bool) -> Rows:
    """Yield how `tour-search` stands to the best of the rivals at equal time."""
    seconds = vehicles / 10
    ours, best = [], []
    for model in papers.papers(vehicles):
        rivals = [
            search.run(model, backend, 0, seconds, **options, interior=interior).primal_bound
            for backend, options in search.RIVALS.values()
        ]
        best.append(min(rivals))
        found = search.run(model, "tour-search", 0, seconds, **search.ENDLESS, interior=interior)
        ours.append(found.primal_bound)
    ratio = np.array(ours) / np.array(best)
    p = float(wilcoxon(np.log(ratio), alternative="less").pvalue)
    yield (vehicles, seconds, float(np.median(ratio)), float(ratio.max()), p)


def best(vehicles: int) -> Rows:
    """The search beside the best of the rivals, encounters on the boundary."""
    yield from _rival(vehicles, False)


def inside(vehicles: int) -> Rows:
    """The same with encounters inside the discs."""
    yield from _rival(vehicles, True)


def gaps(vehicles: int) -> Rows:
    """The gap to the proven bound, all defaults."""
    found = [
        search.run(generate(vehicles, float(kappa), 1000 * vehicles + row), "tour-search", 0, None)
        for row, kappa in enumerate(np.linspace(2.5, 17.0, 10), 1)
    ]
    apart = [one.gap for one in found]
    seconds = float(np.median([one.seconds["solve"] for one in found]))
    yield (vehicles, seconds, float(np.median(apart)), float(max(apart)))


def spread(vehicles: int) -> Rows:
    """How far apart five seeds end."""
    seconds, apart = EACH * vehicles, []
    for kappa in (2.5, 6.0, 10.0, 17.0):
        model = generate(vehicles, kappa, 2000 * vehicles + len(apart) + 1)
        lengths = np.array(
            [
                search.run(model, "tour-search", seed, seconds, **search.ENDLESS).primal_bound
                for seed in range(5)
            ]
        )
        apart.append(float(lengths.std() / lengths.mean()))
    yield (vehicles, seconds, *apart)


def public(discs: int) -> Rows:
    """Public static closed tours beside the published upper bounds, every third instance."""
    known = read_best_known(search.DATA / "best_known.csv")
    names = sorted(name for name in known if name.startswith(f"dtspn-{discs:02}-"))[::3]
    above, own = [], []
    for name in names:
        model = read_dtspn(search.DATA / f"{name.removesuffix('.txt')}.txt")
        found = search.run(model, "tour-search", 0, EACH * discs, patience=10**6)
        above.append(found.primal_bound / known[name][1] - 1)
        own.append(found.gap)
    shorter = sum(one < -1e-7 for one in above)
    ends = (float(np.median(above)), max(above), min(above))
    yield (discs, len(names), EACH * discs, *ends, shorter, float(np.median(own)))


_P = ".2g"
_VEHICLES = {"vehicles": "", "seconds": ".2f"}
_RATIO = {"median ratio": ".3f", "worst": ".3f", "p": _P}
#: What each table is made of: rows, heads with formats.
TABLES: dict[str, tuple[Callable[[int], Rows], tuple[int, ...], dict[str, str]]] = {
    "three": (
        three, (2, 3),
        {**_VEHICLES, "MA shorter on": "", "of": "", "mean difference": "+.2%", "p": _P},
    ),
    "four": (
        four, (10, 20, 30, 40),
        {
            **_VEHICLES, "MA (m)": ".0f",
            **dict.fromkeys((one.label for one in papers.RIVALS[1:]), ".2f"),
            "p of MA-T": _P, "p of VNS": _P, "paper: MA (m)": "",
        },
    ),
    "six": (six, (1, 5, 10), {"r_min": "", "r_com = 1": ".2f", "5": ".2f", "10": ".2f"}),
    "period": (period, (1, 4, 10, 21), {"period": "", "median ratio": ".3f", "p": _P}),
    "best": (best, (10, 20, 30, 40), {**_VEHICLES, **_RATIO}),
    "inside": (inside, (10, 20, 30, 40), {**_VEHICLES, **_RATIO}),
    "gaps": (gaps, (5, 10, 20), {**_VEHICLES, "median gap": ".2%", "worst": ".2%"}),
    "spread": (
        spread, (30, 40),
        {**_VEHICLES, "sparsity 2.5": ".1%", "6": ".1%", "10": ".1%", "17": ".1%"},
    ),
    "public": (
        public, (6, 8, 10, 12, 14, 16, 18, 20, 25, 30),
        {
            "discs": "", "instances": "", "seconds": ".1f", "median difference": "+.0e", "largest": "+.0e",
            "least": "+.0e", "shorter on": "", "median gap to our bound": ".0e",
        },
    ),
}  # fmt: skip


def main(name: str, *some: str) -> None:
    """Make a table, or some of its rows."""
    make, every, columns = TABLES[name]
    model = generate(3, 5.0, 1)
    for one in (*papers.RIVALS, papers.DS):  # what the first call compiles
        ct.solve(model, one.backend)
    ct.solve(model, "tour-search", time_limit=1)
    for size in map(int, some or map(str, every)):
        rows = list(make(size))
        print(name, *rows, flush=True)
        write("messenger", name, __file__, columns, rows, ("numba",), merge=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

"""1,000 random trajectories against an elimination in a hundred digits.

They have 2 … 1000 segments, ratios of durations up to 1e6, orders 2 … 5, and any pattern of fixed and free
derivatives. An answer reported as optimal must have the optimum's objective and shape, no bound may exceed the
optimum, and a refusal must have a message. The table counts the answers.
"""

from __future__ import annotations

from collections import Counter

import pytest
from benchmarks.ledger import Ledger, Row
from minimum_snap.drawn_trajectories import drawn
from minimum_snap.judged import judge

import crosstrack as ct

GROUP = 100


@pytest.mark.parametrize("first", range(0, 1000, GROUP))
def test_random_trajectories(first: int, ledger: Ledger) -> None:
    count: Counter[str] = Counter()
    wrong = []
    for seed in range(first, first + GROUP):
        model = drawn(seed)
        word, why = judge(model, ct.solve(model))
        count[word] += 1
        if word == "WRONG":
            wrong.append(f"{model.name}: {why}")
    words = ", ".join(f"{word} {number}" for word, number in sorted(count.items()))
    ledger.titles["random trajectories"] = "random trajectories against the exact optimum"
    name = f"seeds {first} … {first + GROUP - 1}"
    ledger.rows.append(Row("random trajectories", name, outcome=words))
    assert not wrong, "\n".join(wrong)

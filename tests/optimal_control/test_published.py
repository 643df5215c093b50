"""Published problems of the benchmarks: declarations, sources and the frozen half."""

import hashlib
import math
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parents[1] / "benchmarks" / "optimal_control"
sys.path.insert(0, str(HERE))
try:
    import published
    from declared_problem import Table
    from unseen import UNSEEN
finally:
    sys.path.remove(str(HERE))

#: SHA-256 of the sorted names of the frozen half of `unseen`, which was drawn on 2026-11-27.
DRAWN = "c9f4632e69f3585a937e3c495d7b411c4e21f32770a50bcde9504ad98fb1598e"


@pytest.mark.parametrize("name", published.PUBLISHED)
def test_declaration_builds(name):
    problem = published.PUBLISHED[name].build(name)
    assert problem.definition.phases
    assert math.isfinite(problem.definition.phases[0].guess.end)


def test_values_and_sources_are_complete():
    for name, problem in published.PUBLISHED.items():
        assert len(problem.source) > 20, name
        assert 0 < problem.exact < 0.1, name
        assert problem.value is None or math.isfinite(problem.value), name
        assert problem.value is not None or "programs" in problem.source, name


def test_set_has_at_least_seventy_problems_in_short_modules():
    assert len(published.PUBLISHED) >= 70
    for module in published.MODULES:
        assert len(Path(module.__file__).read_text().splitlines()) <= 400


def test_names_are_unique():
    table = Table()
    table(1.0, "first source", name="same")(print)
    with pytest.raises(ValueError, match="declared twice"):
        table(2.0, "second source", name="same")(print)
    assert not set(UNSEEN) & set(published.PUBLISHED)


def test_halves_are_drawn_by_hash_and_share_no_problem():
    frozen, development = published.frozen(), published.development()
    everything = published.problems()
    assert set(frozen) | set(development) == set(everything)
    assert not set(frozen) & set(development)
    for name in everything:
        odd = hashlib.sha256(name.encode()).digest()[0] % 2 == 1
        assert (name in frozen) == odd
    assert 0.35 < len(frozen) / len(everything) < 0.65


def test_frozen_half_of_the_older_set_is_unchanged():
    names = ",".join(sorted(name for name in UNSEEN if published.is_frozen(name)))
    assert hashlib.sha256(names.encode()).hexdigest() == DRAWN


def test_the_page_states_how_many_frozen_problems_are_older():
    page = (HERE.parents[2] / "docs" / "how-well.md").read_text("utf-8")
    older = sum(published.is_frozen(name) for name in UNSEEN)
    assert f"{older} of the {len(published.frozen())} are in `unseen.py`" in page

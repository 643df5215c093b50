r"""Conversion between shortest common supersequences of binary words and guided path tours.

A word becomes a chain: the hub at 2, the place of its first letter, the hub, the place of its second
letter, …, the hub. The letters are at 1 and 3, on both sides of the hub, and the start is at 0. Two
letters of one chain are separated by the hub, so each sequence of services away from the hub is one
letter of a common supersequence, and costs 2. The shortest tour is therefore :math:`2\,s + 4` long,
where :math:`s` is the length of the shortest common supersequence. The supersequence problem is
NP-hard for two letters and any number of words. So is the shortest tour for any number of chains,
even with only three places.

Sources: the reduction is ours. K.-J. Räihä, E. Ukkonen, "The shortest common supersequence problem over
binary alphabet is NP-complete", Theoretical Computer Science 16, 1981.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

from ...errors import InvalidData
from ...models.fields import required, show
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan

__all__ = ["HUB", "PLACES", "supersequence_of", "supersequence_tour"]

#: Coordinates of the first and the second letter, and of the hub between them.
PLACES, HUB = (1.0, 3.0), 2.0


def supersequence_tour(
    words: Sequence[str], letters: str = "ab", *, name: str = ""
) -> GuidedPathTour:
    """Return the tour whose least length is 4 more than twice that of the shortest common supersequence.

    Parameters
    ----------
    words : sequence of str
        Words of two letters, one per chain. An empty word is a single visit to the hub.
    letters : str
        The two letters.
    name : str
        Name of the model.

    Returns
    -------
    GuidedPathTour
        The model.

    Raises
    ------
    InvalidData
        `words` is empty, or contains another letter.
    """
    _check_letters(letters)
    if isinstance(words, str) or not isinstance(words, Sequence) or not words:
        raise InvalidData(f"words must be a list of some words, got {show(words)}", field="words")
    coordinates, chains = [0.0], []
    for k, word in enumerate(words):
        if not isinstance(word, str) or not set(word) <= set(letters):
            raise InvalidData(
                f"words[{k}] must consist of the letters {letters[0]!r} and {letters[1]!r}, got "
                f"{show(word)}",
                field="words",
            )
        begin = len(coordinates)
        for letter in word:
            coordinates += [HUB, PLACES[letters.index(letter)]]
        coordinates.append(HUB)
        chains.append(list(range(begin, len(coordinates))))
    return GuidedPathTour.from_data({"coordinates": coordinates, "chains": chains}, name=name)


def supersequence_of(model: GuidedPathTour, plan: GuidedPathPlan, letters: str = "ab") -> str:
    """Return the common supersequence of a tour of :func:`supersequence_tour`.

    Its length is half of the tour's length minus 4, also if the tour is not optimal.

    Parameters
    ----------
    model : GuidedPathTour
        Model of the plan.
    plan : GuidedPathPlan
        A feasible plan, not necessarily optimal.
    letters : str
        The two letters.

    Returns
    -------
    str
        The supersequence.

    Raises
    ------
    InvalidData
        A customer is neither at a letter nor at the hub, or the plan is infeasible.
    """
    _check_letters(letters)
    required("model", model, GuidedPathTour)
    others = set(model.coordinates[1:].tolist()) - {*PLACES, HUB}
    if others or model.coordinates[0] != 0.0:
        raise InvalidData(
            "coordinates must be those of a supersequence, 0 of the start and 1, 2, 3 of customers, "
            f"got {show(min(others, default=float(model.coordinates[0])))}",
            field="coordinates",
        )
    verification = model.verify(required("plan", plan, GuidedPathPlan))
    if not verification.ok:
        raise InvalidData(
            f"plan must be valid, it breaks: {verification.violated[0].name}", field="plan"
        )
    places: Iterable[float] = (float(model.coordinates[customer]) for customer in plan.order)
    runs = (place for place, _ in itertools.groupby(places))
    return "".join(letters[PLACES.index(place)] for place in runs if place != HUB)


def _check_letters(letters: str) -> None:
    if not isinstance(letters, str) or len(set(letters)) != 2 or len(letters) != 2:
        raise InvalidData(
            f"letters must be two different ones, got {show(letters)}", field="letters"
        )

"""Sequential ordering problems of TSPLIB (``.sop``) whose distances are those of a line.

The first node of a file is the start, and the last one is the end, at the place of the start. An
entry of -1 in row i and column j means that node j precedes node i. Other entries are distances
from i to j. Files of SOPLIB contain only the rows of the matrix.

Source: G. Reinelt, "TSPLIB: a traveling salesman problem library", ORSA Journal on Computing 3, 1991.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation
from ...files import as_path, read_text, write_text
from ...models.fields import required
from ...models.guided_path.data import MOST_DENSE
from ...models.guided_path.extensions import name_unsupported
from ...models.guided_path.model import GuidedPathTour
from ..sections import KeywordFile
from ..tables import NUMBER

__all__ = ["INFINITE", "read_matrix", "read_sop", "sop_text", "tour_text", "write_sop"]

Floats = NDArray[np.float64]

#: Tolerance of distances, relative to the longest one.
_ROUNDING = 1e-9
#: Distance of a missing arc; that from the start to the end is missing.
INFINITE = 1_000_000
#: Supported keywords of the format with their values.
_HEAD = {
    "TYPE": ("SOP",), "EDGE_WEIGHT_TYPE": ("EXPLICIT",), "EDGE_WEIGHT_FORMAT": ("FULL_MATRIX",)
}  # fmt: skip
_KNOWN = dict.fromkeys(("NAME", "COMMENT", "DIMENSION", "EDGE_WEIGHT_SECTION"), ()) | _HEAD


def read_sop(path: str | os.PathLike[str]) -> GuidedPathTour:
    """Return the tour of a TSPLIB file with a sequential ordering problem.

    Distances determine neither the direction nor the origin of the line. The start is at 0, and the
    node farthest from it is to the right. Customers are the nodes 2, 3, … of the file, in order.
    The relation is stated as chains if possible, otherwise as the fewest pairs.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    GuidedPathTour
        The model.

    Raises
    ------
    InvalidData
        The file is not such a problem, a number is missing or malformed, the relation has a cycle,
        or the distances differ from those of a line by more than 1e-9 of the longest distance. The
        message contains the file, and the nodes if applicable.
    """
    file = as_path(path)
    matrix, before = read_matrix(file, MOST_DENSE + 2, "coordinates")
    try:
        places = _places(matrix, before)
        relation = _relation(before[1:-1, 1:-1].T)
        return GuidedPathTour.from_data({"coordinates": places, **relation}, name=file.stem)
    except InvalidData as error:
        raise InvalidData(f"{file}: {error}", field=error.field) from None


def read_matrix(file: Path, most: int, field: str) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the distances of a file with at most `most` nodes, and whether node j must precede node i.

    Raise :class:`InvalidData` with `field` for a matrix that is no sequential ordering problem.
    """
    matrix = _matrix(file, most, field)
    broken = np.argwhere((matrix < 0) & (matrix != -1))
    if len(broken):
        i, j = broken[0]
        raise InvalidData(
            f"{file}: entry {i + 1}, {j + 1} must be a distance or -1, got {matrix[i, j]:g}",
            field=field,
        )
    before = matrix == -1  # row i, column j: j precedes i
    np.fill_diagonal(before, False)
    if before[0].any() or before[:, -1].any():
        node = int(np.append(np.flatnonzero(before[0]), np.flatnonzero(before[:, -1]))[0])
        raise InvalidData(
            f"{file}: node 1 must come first and node {len(matrix)} last, the precedence of node "
            f"{node + 1} says otherwise",
            field="precedence",
        )
    both = np.argwhere(before & before.T)
    if len(both):
        i, j = both[0]
        raise InvalidData(
            f"{file}: precedence must have no cycle, nodes {i + 1} and {j + 1} each precede the other",
            field="precedence",
        )
    return matrix, before


def _relation(precedes: NDArray[np.bool_]) -> dict[str, list[list[int]]]:
    """Return the relation as chains if possible, otherwise as the fewest pairs."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    if connected_components(csr_array(precedes), connection="strong")[0] < len(precedes):
        # The relation has a cycle, which the model reports.
        return {"precedence": (np.argwhere(precedes) + 1).tolist()}
    # Omit pairs that other pairs imply.
    weights = precedes.astype(np.float32)
    pairs = (np.argwhere(precedes & (weights @ weights == 0)) + 1).tolist()
    after = {int(first): int(second) for first, second in pairs}
    followers = set(after.values())
    if len(after) < len(pairs) or len(followers) < len(pairs):
        return {"precedence": pairs}
    chains = [[head] for head in after if head not in followers]
    for chain in chains:
        while chain[-1] in after:
            chain.append(after[chain[-1]])
    return {"chains": chains}


def _places(matrix: Floats, before: NDArray[np.bool_]) -> Floats:
    """Return the coordinates of the start and the customers, computed from distances."""
    # The last node is the start again: distances to it are distances to the start.
    apart = matrix[:-1, :-1].copy()
    apart[1:, 0] = apart[0, 1:]
    mutual = before[:-1, :-1]
    apart[mutual] = apart.T[mutual]
    np.fill_diagonal(apart, 0.0)
    far = int(apart[0].argmax())
    # A node is on the side of the far node if its distance to the far node is the shorter
    # alternative.
    ahead = np.abs(apart[far] - (apart[0, far] - apart[0])) <= np.abs(
        apart[far] - (apart[0, far] + apart[0])
    )
    places: Floats = np.where(ahead, apart[0], -apart[0])
    line = np.abs(places[:, None] - places)
    expected = np.zeros_like(matrix)
    expected[:-1, :-1] = line
    expected[:-1, -1] = line[:, 0]
    mask = ~before
    mask[0, -1] = False
    mask[-1] = False
    np.fill_diagonal(mask, False)
    mask[1:, 0] = False
    off = np.where(mask, np.abs(matrix - expected), 0.0)
    i, j = np.unravel_index(int(off.argmax()), off.shape)
    if off[i, j] > _ROUNDING * line.max():
        raise InvalidData(
            f"distances must be those of a line: with nodes 1 and {far + 1} at 0 and "
            f"{apart[0, far]:.10g} and the others by their distances from these, nodes {i + 1} and "
            f"{j + 1} are {expected[i, j]:.10g} apart, got {matrix[i, j]:.10g}",
            field="coordinates",
        )
    return places


def _matrix(file: Path, most: int, field: str) -> Floats:
    """Return the distance matrix of a file."""
    rows = [words for line in read_text(file).splitlines() if (words := line.split())]
    if rows and NUMBER.fullmatch(rows[0][0]):  # SOPLIB has no keywords
        content = KeywordFile(file, {"DIMENSION": str(len(rows))}, {"EDGE_WEIGHT_SECTION": rows})
    else:
        content = KeywordFile.read(file, _KNOWN)
        for keyword, allowed in _HEAD.items():
            content.require(keyword, allowed)
    size = content.size(3 if field == "coordinates" else 2, most)
    numbers = content.numbers("EDGE_WEIGHT_SECTION", field)
    # The section may begin with the dimension, whereas a matrix begins with the 0 of its diagonal.
    if numbers.size and numbers[0] == size:
        numbers = numbers[1:]
    if numbers.size != size**2:
        raise InvalidData(
            f"{file}: EDGE_WEIGHT_SECTION must hold {size} × {size} numbers, got {numbers.size}",
            field=field,
        )
    return numbers.reshape(size, size)


def write_sop(model: GuidedPathTour, path: str | os.PathLike[str]) -> Path:
    """Write a tour as a sequential ordering problem of TSPLIB; return the path.

    Node 1 is the start, nodes 2, 3, … are customers 1, 2, …, and the last node is the end. The file
    contains the transitive closure of the relation. Distances are integers if the coordinates are,
    because many readers accept only integers. The file is written atomically.

    Parameters
    ----------
    model : GuidedPathTour
        The tour.
    path : path-like
        The file, usually with the suffix ``.sop``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InvalidData
        The file cannot be written.
    UnsupportedFormulation
        The model has optional fields.
    """
    places = required("model", model, GuidedPathTour).coordinates
    if reason := name_unsupported(model):
        raise UnsupportedFormulation(f"a sequential ordering problem does not cover {reason}")
    size = model.size + 1
    whole = bool((places == np.round(places)).all() and np.abs(places).max() < 2**52)
    # The distance of the unused arc must exceed all others.
    way = INFINITE if np.ptp(places) < INFINITE else 10 * int(np.ptp(places))
    words = []
    for i, here in enumerate(places):
        row = np.abs(places - here)
        line = list(map(str, (row.astype(np.int64) if whole else row).tolist()))
        for j in np.flatnonzero(model.closure[:, i]).tolist():
            line[j] = "-1"
        back = line[0]
        if i:
            line[0] = "-1"
        words.append([*line, back if i else str(way)])
    words.append(["-1"] * (size - 1) + ["0"])
    comment = f"a line of {model.size - 1} customers"
    return write_text(path, sop_text(model.name, comment, words))


def tour_text(name: str, size: int, nodes: Sequence[int]) -> str:
    """Return the text of a tour of TSPLIB through nodes counted from 1, of `size` nodes."""
    head = [f"NAME: {' '.join(name.split()) or 'tour'}", "TYPE: TOUR", f"DIMENSION: {size}"]
    return "\n".join([*head, "TOUR_SECTION", *map(str, nodes), "-1", "EOF"]) + "\n"


def sop_text(name: str, comment: str, words: list[list[str]]) -> str:
    """Return the text of a file with these entries of the matrix."""
    lines = [
        f"NAME: {' '.join(name.split()) or 'tour'}",
        "TYPE: SOP",
        f"COMMENT: {comment}",
        f"DIMENSION: {len(words)}",
        "EDGE_WEIGHT_TYPE: EXPLICIT",
        "EDGE_WEIGHT_FORMAT: FULL_MATRIX",
        "EDGE_WEIGHT_SECTION",
        str(len(words)),
    ]
    return "\n".join([*lines, *map(" ".join, words), "EOF"]) + "\n"

"""Rules of neighbours and moving obstacles for tests, and questions to a simulator."""

import dataclasses

import numpy as np
from hypothesis import strategies as st

from crosstrack.models.unknown_grid.world import Looks


@st.composite
def rules(draw, **fixed):
    """Draw the fields of neighbours, corners and moving obstacles."""
    connectivity = draw(st.sampled_from("48"))
    return {
        "connectivity": connectivity,
        "corners": draw(st.sampled_from(["free", "one", "any"])) if connectivity == "8" else "free",
        "moving": draw(st.integers(0, 3)),
        "world_seed": draw(st.integers(0, 99)),
        **fixed,
    }


def with_rules(model, fields):
    return dataclasses.replace(model, **fields)


def look(world, questions):
    questions = np.array(questions, float)
    return Looks.read(world.problem, questions[:, 0].astype(int), world(questions))


def plain_request():
    from crosstrack.solvers import Control, Request

    return Request(options={}, control=Control())

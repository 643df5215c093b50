"""The program of a route with resources, against labelling and enumeration."""

import pytest
from resource_draws import least_length, random_branches, random_model, rng_of

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import Resource, ResourceRouting, Route


@pytest.mark.parametrize("draw", [random_model, random_branches])
@pytest.mark.parametrize("seed", range(200, 208))
def test_optimum_and_encoded_plan(draw, seed):
    model = draw(rng_of(seed), revisits=False)
    found, labels = ct.solve(model, "highs"), ct.solve(model, "resource-labelling")
    assert found.termination == labels.termination
    if labels.plan is None:
        return
    assert found.primal_bound == pytest.approx(labels.primal_bound, rel=1e-9, abs=1e-9)
    formulation = model.formulate("arc-flow")
    point = formulation.encode(labels.plan)
    assert formulation.program.verify(point).ok
    assert formulation.decode(point) == labels.plan
    assert formulation.floor <= labels.primal_bound * (1 + 1e-12)


def between(reset, limit):
    """Three legs of 4 in a line; the middle points reset to at most `reset`."""
    fuel = Resource(
        "fuel",
        1.0,
        limits={"mid": limit, "end": limit},
        resets={"mid": reset} if reset is not None else {},
    )
    return ResourceRouting(
        ("start", "mid", "mid", "end"),
        (fuel,),
        0,
        3,
        arcs=[[0, 1], [1, 2], [2, 3]],
        lengths=[4, 4, 4],
    )


@pytest.mark.parametrize(
    ("reset", "limit", "valid"),
    [
        *(
            (0, 4, True),
            (0, 3.9, False),
            (1, 5, True),
            (1, 4.9, False),
            (3, 7, True),
            (3, 6.9, False),
        ),
        *((None, 12, True), (None, 11.9, False), (5, 9, True), (5, 8.9, False), (4, 8, True)),
    ],
)
def test_resets_of_every_kind(reset, limit, valid):
    model = between(reset, limit)
    assert model.verify(Route((0, 1, 2, 3))).ok is valid
    for backend in ("resource-labelling", "highs"):
        assert (ct.solve(model, backend).plan is not None) is valid
    if valid:
        formulation = model.formulate()
        assert formulation.program.verify(formulation.encode(Route((0, 1, 2, 3)))).ok


def test_unsupported_models_are_refused():
    model = random_model(rng_of(3), revisits=True)
    with pytest.raises(UnsupportedFormulation, match="revisits"):
        model.formulate("arc-flow")
    formulation = between(0, 4).formulate("arc-flow")
    with pytest.raises(InvalidData, match="excluded"):
        formulation.encode(Route((0, 2, 3)))
    with pytest.raises(InvalidData, match="entries"):
        formulation.decode(formulation.encode(Route((0, 1, 2, 3)))[:-1])


def test_helper_agrees_with_walks():
    model = between(1, 5)
    assert least_length(model) == 12

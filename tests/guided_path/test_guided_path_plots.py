"""Plots of guided path tours: the artists agree with the model and the plan."""

import itertools

import numpy as np
import pytest
from guided_path.enumerated import KINDS, RELATIONS, extensions, random_tour
from pictures import artists, legend, render, words

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.instances.guided_path import generate
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path import GuidedPathPlan
from crosstrack.models.guided_path.plot import animate_tour


@pytest.fixture(scope="module")
def five():
    """Return two chains, a customer in no chain, and a pair between chains."""
    model = GuidedPathTour(
        [1, 4, 2, 7, 3, -2],
        chains=[[1, 2], [3, 4]],
        precedence=[[2, 3]],
        ids=["home", *"abcde"],
        name="five",
    )
    return model, GuidedPathPlan([5, 1, 2, 3, 4])


def line(axes, gid):
    (found,) = artists(axes, gid)
    return np.column_stack(found.get_data())


def dots(axes, gid="customer"):
    """Return every marker of one kind, with its colour."""
    return {
        (*map(float, place), tuple(float(x) for x in found.get_facecolors()[0, :3]))
        for found in artists(axes, gid)
        for place in found.get_offsets()
    }


def segments(axes, gid):
    return [part.tolist() for found in artists(axes, gid) for part in found.get_segments()]


def test_draws_chains_and_tour(five, tmp_path):
    model, plan = five
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "tour.png", dpi=40)
    chains, tour = figure.axes
    places, walked = [1, -2, 4, 2, 7, 3, 1], [0, 3, 9, 11, 16, 20, 22]
    assert line(tour, "vehicle").tolist() == [list(at) for at in zip(places, walked, strict=True)]
    served = dots(tour)
    assert {at[:2] for at in served} == set(list(zip(places, walked, strict=True))[1:-1])
    colours = {at[0]: at[2] for at in served}
    assert colours[4] == colours[2] != colours[7] == colours[3]
    assert colours[-2] not in (colours[4], colours[7])
    # In their panel, chains descend in the order of service, with the same colours.
    assert {(at[0], at[2]) for at in dots(chains)} == {(at[0], at[2]) for at in served}
    (one, other) = artists(chains, "chain")
    assert [one.get_xdata().tolist(), other.get_xdata().tolist()] == [[4, 2], [7, 3]]
    assert (np.diff(one.get_ydata()) > 0).all()
    assert [[end[0] for end in pair] for pair in segments(chains, "pair")] == [[2, 7]]
    assert [mark.get_offsets().tolist() for mark in artists(tour, "start")] == [[[1, 0], [1, 22]]]
    assert not artists(tour, "wrong order")
    assert tour.get_ylim()[0] > tour.get_ylim()[1]
    assert chains.get_xlim() == tour.get_xlim()
    assert figure.get_suptitle() == "five  ·  5 customers, 2 chains, 1 pair, 22 m"
    assert {"a", "e", "chain 1", "no chain", "position (m)", "walked (m)"} <= set(words(figure))
    named = ["start", "further pair", "vehicle", "chain 0", "chain 1", "in no chain"]
    assert legend(figure) == named


def test_draws_the_given_parts(five):
    model, plan = five
    (chains,) = render(ct.plot(model)).axes
    assert artists(chains, "chain")
    assert not artists(chains, "vehicle")
    (tour,) = render(ct.plot(model, plan, parts=["tour"], over="stops", labels=False)).axes
    assert line(tour, "vehicle")[:, 1].tolist() == list(range(7))
    assert not tour.texts
    assert artists(tour, "chain")
    (bare,) = ct.plot(model, plan, parts=["tour"], lines=False).axes
    assert not artists(bare, "chain")
    figure = render(ct.plot(model, plan, title="mine", size=(3, 2)))
    assert figure.get_suptitle() == "mine"
    assert figure.get_size_inches().tolist() == [3, 2]
    (small,) = figure.axes
    assert not small.texts
    both = ct.plot(model, plan, parts=["tour", "chains"], size=(3, 2)).axes
    assert len(both) == 2
    assert artists(both[0], "pair")


def test_violations_are_red(five):
    model, _ = five
    figure = render(ct.plot(model, GuidedPathPlan([5, 2, 1, 1, 4])))
    _, tour = figure.axes
    # Customer 2 comes before 1. Customer 3 is missing, so its pairs have no order.
    assert segments(tour, "wrong order") == [[[4, 9], [2, 7]]]
    (rings,) = artists(tour, "not served once")
    assert rings.get_offsets().tolist() == [[4, 9], [4, 9], [7, 0]]
    assert "NOT VALID: each customer served once, precedence" in figure.get_suptitle()
    assert {"wrong order", "not served once"} <= set(legend(figure))
    with pytest.raises(InvalidData, match=r"order\[0\] must be in 1 … 5, got 6"):
        ct.plot(model, GuidedPathPlan([6]))


@pytest.mark.parametrize("order", [[], [1], [1, 1, 1], [2, 1] * 50])
def test_plans_that_are_far_from_valid_are_drawn(five, order, tmp_path):
    figure = ct.plot(five[0], GuidedPathPlan(order))
    figure.savefig(tmp_path / "tour.png", dpi=20)
    assert "NOT VALID" in figure.get_suptitle()


@pytest.mark.parametrize(
    ("kind", "relation"), list(zip(KINDS, itertools.cycle(RELATIONS), strict=False))
)
@pytest.mark.filterwarnings("error")
def test_tours_of_every_kind_are_drawn(kind, relation):
    model = random_tour(len(kind) + 10 * len(relation), 6, kind, relation)
    render(ct.plot(model))
    plan = GuidedPathPlan(extensions(model)[-1])
    figure = render(ct.plot(model, plan))
    drawn = line(figure.axes[-1], "vehicle")
    length = model.verify(plan).objective
    total = np.abs(np.diff(drawn[:, 0])).sum()
    extent = np.ptp(model.coordinates)
    # The length unit of the figure cancels.
    if extent:
        assert total / np.ptp(drawn[:, 0]) == pytest.approx(
            length / np.ptp(model.coordinates[[0, *plan.order]])
        )
    assert "NOT VALID" not in figure.get_suptitle()


@pytest.mark.filterwarnings("error")
def test_many_customers_and_many_chains(tmp_path):
    long = generate(1, 300, 1)
    figure = ct.plot(long, GuidedPathPlan(range(1, 301)))
    figure.savefig(tmp_path / "long.png", dpi=30)
    assert len(line(figure.axes[1], "vehicle")) == 302
    assert not figure.axes[0].texts
    assert figure.axes[1].get_ylabel() == "walked (km)"
    wide = generate(60, 5, 1)
    (tour,) = render(ct.plot(wide, GuidedPathPlan(range(1, 301)))).axes
    assert not artists(tour, "chain")
    looks = {
        (tuple(found.get_facecolors()[0]), found.get_paths()[0].vertices.tobytes())
        for found in artists(tour, "customer")
    }
    assert len(looks) == 35  # what colours and markers can tell apart
    (rows,) = ct.plot(wide).axes
    assert len(artists(rows, "chain")) == 60
    assert rows.get_ylabel() == "chain (number)"
    assert "… 60 chains in all" in legend(ct.plot(wide))


def test_customers_at_one_place_share_a_name():
    model = GuidedPathTour([0, 1, 1, 1, 2, 2, 2, 2, 2], ids=["s", *"abcdefgh"])
    (tour,) = render(ct.plot(model, GuidedPathPlan(range(1, 9)), parts=["tour"])).axes
    assert {text.get_text() for text in tour.texts} == {"a, b, c", "d, e, 3 more"}


def test_relations_without_chains_have_the_fewest():
    model = GuidedPathTour([0, 1, 2, 3, 4], precedence=[[1, 2], [2, 3], [1, 4]])
    (chains,) = ct.plot(model).axes
    drawn = artists(chains, "chain")
    assert [found.get_xdata().tolist() for found in drawn] == [[1, 2, 3]]
    assert [[end[0] for end in pair] for pair in segments(chains, "pair")] == [[1, 4]]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parts": ["tour", "map"]}, "parts must hold some of 'chains', 'tour'"),
        ({"parts": "tour"}, "parts must hold"),
        ({"parts": []}, "parts must hold"),
        ({"over": "hours"}, "over must be 'walked', 'stops' or 'time', got 'hours'"),
        ({"lines": 1}, "lines must be True or False"),
        ({"labels": "yes"}, "labels must be True or False"),
        ({"tolerance": 0}, "tolerance must"),
        ({"size": (0, 1)}, "size must be"),
        ({"zoom": True}, "no option 'zoom'"),
    ],
)
def test_rejects_bad_options(five, options, message):
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(*five, **options)


def test_a_tour_needs_a_plan(five):
    with pytest.raises(UnsupportedOption, match="only if plan is given"):
        ct.plot(five[0], parts=["tour"])


# -- in motion -----------------------------------------------------------------------------------


def test_an_animation_follows_the_tour(five, tmp_path):
    model, plan = five
    film = animate_tour(model, plan, frames=12, size=(3, 3))
    film.save(tmp_path / "tour.gif", writer="pillow", dpi=30)
    assert (tmp_path / "tour.gif").stat().st_size > 1000
    film._func(5)
    (axes,) = film._fig.axes
    found = (artists(axes, gid) for gid in ("way", "vehicle", "customer"))
    ((way,), (vehicle,), (customers,)) = found
    # After 10 m the vehicle is between customers 1 and 2.
    assert [vehicle.get_xdata()[0], vehicle.get_ydata()[0]] == pytest.approx([3, 10])
    assert way.get_xdata().tolist() == pytest.approx([1, -2, 4, 3])
    assert "10 m of 22 m, 2 of 5 served" in words(film._fig)
    faces = [tuple(face) for face in customers.get_facecolors()]
    assert faces[2] == faces[3] == faces[4]
    assert len(set(faces[:2])) == 2
    film._func(11)
    assert any(text.endswith("5 of 5 served") for text in words(film._fig))
    still = animate_tour(GuidedPathTour([0, 0, 0]), GuidedPathPlan([1, 2]), frames=2)
    still.save(tmp_path / "still.gif", writer="pillow", dpi=20)
    still._func(0)
    assert "0 m of 0 m, 2 of 2 served" in words(still._fig)


def test_rejects_bad_animation_arguments(five):
    model, plan = five
    with pytest.raises(UnsupportedOption, match="frames must"):
        animate_tour(model, plan, frames=1)
    with pytest.raises(InvalidData, match="must be in 1 … 5"):
        animate_tour(model, GuidedPathPlan([9]))

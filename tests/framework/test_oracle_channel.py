"""The channel between a worker and the process that has the hidden data: tables, refusals, its end."""

import contextlib
import socket
import threading

import numpy as np
import pytest

from crosstrack.errors import HiddenData, InvalidData, UnsupportedOption
from crosstrack.solvers.processes import oracles


@contextlib.contextmanager
def channel(oracle):
    """Yield both ends of a channel whose questions `oracle` answers in a thread, which ends with it."""
    ours, theirs = socket.socketpair()
    thread = threading.Thread(target=oracles.serve, args=(ours, lambda: oracle))
    thread.start()
    try:
        yield oracles.Asking(theirs), theirs
    finally:
        theirs.close()
        thread.join(20)
        assert not thread.is_alive()
        assert ours.fileno() == -1, "closed with its thread"


@pytest.mark.parametrize(
    "shape", [(1000, 1000), (1_000_000, 1), (1, 1_000_000), (1, 1), (0, 3), (3, 0)]
)
def test_tables_of_any_size_go_there_and_back(shape):
    table = np.random.default_rng(1).normal(size=shape)
    table.ravel()[:4] = (np.nan, np.inf, -0.0, 5e-324)[: table.size]
    with channel(lambda asked: np.asfortranarray(2 * asked)) as (ask, _):
        for questions in (table, np.asfortranarray(table), table[::-1]):
            answers = ask(questions)
            assert answers.shape == shape and answers.flags.writeable
            np.testing.assert_array_equal(answers, 2 * questions)
        assert ask(np.ones((2, 2), int)).tolist() == [[2, 2], [2, 2]]


class TheirOwn(InvalidData):
    """Of a kind that no other process knows."""


@pytest.mark.parametrize(
    ("error", "kind", "text", "field"),
    [
        (InvalidData("x is – ünclear", field="x"), InvalidData, "x is – ünclear", "x"),
        (UnsupportedOption("no such thing"), UnsupportedOption, "no such thing", None),
        (TheirOwn("strange", field="y"), InvalidData, "strange", "y"),
        (ZeroDivisionError("by zero"), InvalidData, "ZeroDivisionError: by zero", "oracle"),
        (KeyError("a"), InvalidData, "KeyError: 'a'", "oracle"),
        (MemoryError(), InvalidData, "MemoryError: ", "oracle"),
        (SystemExit(3), InvalidData, "SystemExit: 3", "oracle"),
        (KeyboardInterrupt(), InvalidData, "KeyboardInterrupt: ", "oracle"),
        (ValueError("y" * 1_000_000), InvalidData, "ValueError: " + "y" * 1_000_000, "oracle"),
        (ValueError("\ud800"), InvalidData, "ValueError: \ud800", "oracle"),
    ],
)
def test_an_exception_of_an_oracle_is_raised_in_the_worker(error, kind, text, field):
    turns = iter([error, None])

    def moody(table):
        raised = next(turns)
        if raised is not None:
            raise raised
        return table

    with channel(moody) as (ask, _):
        with pytest.raises(InvalidData if kind is InvalidData else kind) as caught:
            ask(np.ones((2, 2)))
        assert type(caught.value) is kind and str(caught.value) == text
        assert getattr(caught.value, "field", None) == field
        assert ask(np.ones((2, 2))).shape == (2, 2), "and the channel goes on"


@pytest.mark.parametrize(
    "answer", [None, 3.0, [1.0, 2.0], "a", [[1j]], np.zeros((2, 2, 2)), [[1], [2, 3]]]
)
def test_an_answer_that_is_not_a_table_is_refused(answer):
    with channel(lambda _: answer) as (ask, _), pytest.raises(InvalidData):
        ask(np.ones((1, 1)))


def test_questions_that_are_not_tables_are_not_sent(monkeypatch):
    asked = []
    with channel(lambda table: asked.append(1) or table) as (ask, _):
        monkeypatch.setattr(oracles, "_MOST", 10)
        for questions in (np.zeros(3), np.zeros((1, 1, 1)), np.zeros((1, 11)), 1.0):
            with pytest.raises(InvalidData, match="two dimensions and at most 10 numbers"):
                ask(questions)
        assert not asked
        assert ask(np.zeros((1, 10))).shape == (1, 10)


def test_a_model_without_an_oracle_raises():
    with channel(None) as (ask, _), pytest.raises(HiddenData, match="answers no questions"):
        ask(np.ones((1, 1)))


def test_an_end_in_the_middle_of_a_question_ends_the_thread():
    with channel(lambda table: table) as (_, theirs):
        theirs.sendall(oracles._HEADER.pack(1000, 1000) + b"12345")
    ours, theirs = socket.socketpair()
    ours.close()
    with theirs, pytest.raises((EOFError, OSError)):
        oracles.Asking(theirs)(np.ones((1, 1)))


def test_several_threads_may_ask_at_once():
    with channel(lambda table: table + 1) as (ask, _):
        found = {}

        def work(k):
            found[k] = [float(ask(np.full((2, 3), k))[1, 2]) for _ in range(50)]

        threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert found == {k: [k + 1.0] * 50 for k in range(4)}


def test_a_closed_end_sends_nothing_and_reports_pending_answers():
    held, asked = threading.Event(), threading.Event()

    def slow(table):
        asked.set()
        held.wait(20)
        return table

    with channel(slow) as (ask, _):
        thread = threading.Thread(target=ask, args=(np.ones((1, 1)),))
        thread.start()
        assert asked.wait(20)
        assert ask.close() is False
        held.set()
        thread.join(20)
        assert ask.close() is True
        with pytest.raises(HiddenData, match="run has ended"):
            ask(np.ones((1, 1)))

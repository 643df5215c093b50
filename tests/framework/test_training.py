"""The training of what learns: checkpoints, resuming, limits, refusals, and files of weights."""

import io
import json
import logging
import pickle
import zipfile

import numpy as np
import pytest
from commands import run

from crosstrack.errors import BackendMissing, InvalidData, UnknownName, UnsupportedOption
from crosstrack.solvers.contract.option import Option
from crosstrack.solvers.learning.trainer import Trainer, Training
from crosstrack.solvers.learning.training import checkpoint_path, find_training, train, trainings
from crosstrack.solvers.learning.weights import (
    Weights,
    read_arrays,
    read_weights,
    write_arrays,
    write_weights,
)

SCORES = (1.0, 3.0, 2.0, 3.0, 0.0)


class Adder(Trainer):
    """Learns sums of drawn numbers, which depend on every epoch before."""

    def __init__(self, course, stop=None):
        self.course, self.stop = course, stop
        self.total = np.zeros(3, np.float32)

    def run_epoch(self, number, tick):
        generator = np.random.default_rng([self.course.seed, number])
        for _ in range(4):
            tick()
            self.total = 0.5 * self.total + generator.random(3, np.float32)
            if self.stop is not None:
                self.stop(number)
        return {"loss": float(self.total.sum()), "score": SCORES[number % len(SCORES)]}

    def state(self):
        return {"total": self.total.copy()}

    def restore(self, state):
        self.total = state["total"]

    def weights(self):
        return Weights("adder", {"total": self.total.copy()}, {"size": 3})


def training(stop=None, **changes):
    options = {"speed": Option(1.0, "how fast", float, lower=0.0)}
    chosen = {"epochs": 5, "options": options, "requires": (), **changes}
    return Training("adder", "adds", lambda course: Adder(course, stop), **chosen)


def total(path):
    return read_weights(path, "adder").arrays["total"]


def test_the_best_epoch_is_written_with_its_origin(tmp_path):
    told = []
    file = tmp_path / "adder.npz"
    done = train(training(), file, seed=4, on_progress=told.append, options={"speed": 2.0})
    assert (done.ended, done.epochs, done.score, done.path) == ("finished", 5, 3.0, file)
    assert [one.best for one in told] == [True, True, False, True, False]
    assert [one.number for one in told] == [1, 2, 3, 4, 5]
    made = read_weights(file, "adder").made
    assert made["best_epoch"] == 4 and made["seed"] == 4
    assert made["command"] == (
        "crosstrack train adder --output FILE.npz --seed 4 --epochs 5 --option speed=2.0"
    )
    assert json.loads(json.dumps(done.to_dict()))["figures"][1]["score"] == 3.0
    again = tmp_path / "again.npz"
    train(training(), again, seed=4, epochs=4, options={"speed": 2.0})
    assert (total(again) == total(file)).all()
    train(training(), again, seed=5)
    assert (total(again) != total(file)).any()


@pytest.mark.parametrize("epoch", [1, 2, 4])
def test_a_resumed_training_equals_an_uninterrupted_one(epoch, tmp_path):
    def stop(number):
        if number == epoch:
            raise KeyboardInterrupt

    whole, parts = tmp_path / "whole.npz", tmp_path / "parts.npz"
    train(training(), whole)
    cut = train(training(stop), parts)
    assert (cut.ended, cut.epochs, cut.score) == ("interrupted", epoch, max(SCORES[:epoch]))
    assert len(total(parts)) == 3
    rest = train(training(), parts, resume=True)
    assert (rest.ended, rest.epochs, len(rest.figures)) == ("finished", 5, 5 - epoch)
    assert (total(parts) == total(whole)).all()
    assert read_weights(parts, "adder").made == read_weights(whole, "adder").made
    states = [read_arrays(checkpoint_path(one)) for one in (parts, whole)]
    assert (states[0][0]["state.total"] == states[1][0]["state.total"]).all()
    assert states[0][1] == states[1][1]


def test_finished_weights_come_back_from_the_checkpoint(tmp_path):
    file = tmp_path / "adder.npz"
    train(training(), file)
    before = total(file)
    file.unlink()
    done = train(training(), file, resume=True)
    assert done.figures == () and done.epochs == 5
    assert (total(file) == before).all()


def test_without_a_finished_epoch_there_are_no_weights(tmp_path):
    def stop(number):
        raise KeyboardInterrupt

    done = train(training(stop), tmp_path / "adder.npz")
    assert (done.ended, done.path, done.epochs) == ("interrupted", None, 0)
    assert list(tmp_path.iterdir()) == []
    assert done.to_dict()["score"] is None


def test_the_time_limit_ends_in_the_middle_of_an_epoch(tmp_path, monkeypatch):
    clock = iter(range(1000))
    monkeypatch.setattr(
        "crosstrack.solvers.learning.training.time.perf_counter", lambda: next(clock)
    )
    done = train(training(), tmp_path / "adder.npz", time_limit=9)
    assert done.ended == "time" and 0 < done.epochs < 5
    assert done.path is not None


@pytest.mark.parametrize(
    ("changes", "field"),
    [({"seed": 1}, "seed"), ({"epochs": 9}, "epochs"), ({"options": {"speed": 2.0}}, "speed")],
)
def test_a_checkpoint_of_another_course_is_refused_by_name(changes, field, tmp_path):
    file = tmp_path / "adder.npz"
    train(training(), file)
    with pytest.raises(InvalidData, match=f"{field} must be") as caught:
        train(training(), file, resume=True, **changes)
    assert caught.value.field == field


def test_a_checkpoint_of_other_examples_is_refused(tmp_path):
    file = tmp_path / "adder.npz"
    train(training(), file, examples=np.zeros)
    with pytest.raises(InvalidData, match="examples must be 'ones'"):
        train(training(), file, examples=np.ones, resume=True)


@pytest.mark.parametrize(
    "about", [{}, {"checkpoint": {}}, {"checkpoint": {}, "done": 1, "best_epoch": 2, "score": 0.5}]
)
def test_a_file_that_is_not_a_checkpoint_is_refused(about, tmp_path):
    write_arrays(checkpoint_path(tmp_path / "adder.npz"), {"a": np.zeros(2)}, about)
    with pytest.raises(InvalidData, match="is no checkpoint"):
        train(training(), tmp_path / "adder.npz", resume=True)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"seed": -1}, "seed must be >= 0"),
        ({"seed": 1.5}, "seed must be"),
        ({"epochs": 0}, "epochs must be >= 1"),
        ({"time_limit": 0}, "time_limit must be"),
        ({"time_limit": "long"}, "time_limit must be"),
        ({"time_limit": float("nan")}, "time_limit must be"),
        ({"options": {"sped": 1.0}}, "no option 'sped'; did you mean 'speed'"),
        ({"options": {"speed": -1.0}}, "must lie in"),
    ],
)
def test_invalid_settings_raise(asked, words, tmp_path):
    with pytest.raises((InvalidData, UnsupportedOption), match=words):
        train(training(), tmp_path / "adder.npz", **asked)
    assert list(tmp_path.iterdir()) == []


def test_files_that_cannot_be_written_raise_before_the_training(tmp_path):
    def stop(number):
        raise AssertionError("it began")

    for path, words in (
        (tmp_path / "weights.bin", "must end in .npz"),
        (tmp_path / "no" / "adder.npz", "does not exist"),
        (None, "must name a file"),
    ):
        with pytest.raises(InvalidData, match=words):
            train(training(stop), path)


def test_a_missing_package_is_named_with_the_extra(tmp_path):
    with pytest.raises(BackendMissing, match=r"no_such_package.*crosstrack\[learn\]"):
        train(training(requires=("no_such_package",)), tmp_path / "adder.npz")


def test_unknown_trainings_are_refused():
    with pytest.raises(UnknownName, match="unknown training 'small-wim': did you mean 'small-vin'"):
        find_training("small-wim")


def test_every_training_can_be_loaded(caplog):
    with caplog.at_level(logging.WARNING, "crosstrack"):
        found = trainings()
    assert not caplog.records
    for name, one in found.items():
        assert one.name == name and one.summary and one.epochs > 0 and one.minutes > 0
        for key, option in one.options.items():
            assert option.default is None or option.check(name, key, option.default) is not None


def test_the_command_lists_and_refuses(tmp_path):
    listed = json.loads(run("train", "--list", "--json").stdout)
    assert {one["training"] for one in listed} == set(trainings())
    assert "small-vin" in run("train").stdout
    run("train", "no-such-training", "--output", tmp_path / "a.npz", code=2)
    assert "--output" in run("train", "small-vin", code=2).stderr
    run("train", "small-vin", "--output", tmp_path / "a.npz", "--option", "sped=1", code=2)


def test_the_command_without_the_package_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "torch", None)
    done = run("train", "small-vin", "--output", tmp_path / "a.npz", code=5)
    assert "crosstrack[learn]" in done.stderr


# -- files of weights -----------------------------------------------------------------------------


def stored(tmp_path, **changes):
    given = {"kind": "adder", "arrays": {"w": np.arange(6.0).reshape(2, 3)}, **changes}
    file = tmp_path / "weights.npz"
    write_weights(file, Weights(**given))
    return file


@pytest.mark.parametrize("dtype", ["float16", "float32"])
def test_weights_come_back(dtype, tmp_path):
    file = tmp_path / "weights.npz"
    write_weights(file, Weights("adder", {"w.a": np.eye(2), "b": np.array(3.5)}), dtype=dtype)
    found = read_weights(file, "adder")
    assert {one.dtype for one in found.arrays.values()} == {np.dtype(dtype)}
    fitted = found.fit({"w.a": (2, 2), "b": ()})
    assert (fitted["w.a"] == np.eye(2)).all() and fitted["b"] == 3.5
    assert fitted["b"].dtype == np.float32


@pytest.mark.parametrize(
    ("shapes", "words"),
    [
        ({"w": (3, 2)}, r"w must have shape \(3, 2\), got \(2, 3\)"),
        ({"w": (2, 3), "b": (1,)}, "'b' is missing"),
        ({}, "'w' belongs to no part"),
    ],
)
def test_arrays_that_do_not_fit_are_named(shapes, words, tmp_path):
    with pytest.raises(InvalidData, match=words):
        read_weights(stored(tmp_path), "adder").fit(shapes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kind": "other"}, "must hold the weights of adder, got 'other'"),
        ({"arrays": {"w": np.array([1.0, np.nan])}}, r"w\[1\] must be finite, got nan"),
        ({"arrays": {"w": np.array([[np.inf]])}}, r"w\[0, 0\] must be finite, got inf"),
        ({"architecture": {"size": 10**9}}, "'size' must be a whole number from 1 to 4096"),
        ({"architecture": {"size": True}}, "'size' must be a whole number"),
    ],
)
def test_weights_that_cannot_be_used_are_refused(changes, words, tmp_path):
    with pytest.raises(InvalidData, match=words):
        read_weights(stored(tmp_path, **changes), "adder")


class Bomb:
    """Fails the test when it is unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("code of a stranger was run",))


def archive(**entries):
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        for name, body in entries.items():
            file.writestr(f"{name}.npy", body)
    return raw.getvalue()


def npy(value, *, allow_pickle=False):
    raw = io.BytesIO()
    np.save(raw, value, allow_pickle=allow_pickle)
    return raw.getvalue()


ABOUT = npy(np.array(json.dumps({"kind": "adder", "architecture": {}, "made": {}})))
STRANGE = {
    "empty": b"",
    "text": b"these are no weights",
    "pickle": pickle.dumps(Bomb()),
    "objects": archive(about=ABOUT, **{"array.w": npy(np.array([Bomb()]), allow_pickle=True)}),
    "no text": archive(**{"array.w": npy(np.zeros(2))}),
    "no JSON": archive(about=npy(np.array("{"))),
    "a list": archive(about=npy(np.array("[]"))),
    "deep": archive(about=npy(np.array("[" * 10**5))),
    "other entry": archive(about=ABOUT, other=npy(np.zeros(2))),
    "cut": archive(about=ABOUT, **{"array.w": npy(np.zeros(99))[:150]}),
    "large": lambda: archive(about=ABOUT, **{"array.w": bytes(2**28 + 1)}),
    "whole numbers": archive(about=ABOUT, **{"array.w": npy(np.arange(3))}),
    "float64": archive(about=ABOUT, **{"array.w": npy(np.zeros(3))}),
    "made": archive(about=npy(np.array(json.dumps({"kind": "adder", "architecture": {}})))),
}


@pytest.mark.parametrize("name", STRANGE)
def test_an_external_file_is_refused_and_runs_nothing(name, tmp_path):
    file = tmp_path / "weights.npz"
    content = STRANGE[name]
    file.write_bytes(content() if callable(content) else content)
    with pytest.raises(InvalidData, match=r"weights\.npz"):
        read_weights(file, "adder")


def test_missing_files_are_refused(tmp_path):
    with pytest.raises(InvalidData, match="no such file"):
        read_weights(tmp_path / "weights.npz", "adder")
    with pytest.raises(InvalidData, match="cannot be read"):
        read_weights(tmp_path, "adder")

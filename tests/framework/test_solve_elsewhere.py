"""What solving does in processes of their own: entry points of others, libraries that clash."""

import os
import subprocess
import sys
import textwrap

from commands import joined


def test_external_entry_points_are_found_and_broken_ones_listed(tmp_path):
    """Two distributions announce backends; one of them cannot be imported."""
    (tmp_path / "stranger.py").write_text(
        textwrap.dedent(
            """
            from crosstrack.models import ErrorCorrectionRouting
            from crosstrack.solvers import Answer, Backend, Guarantee, Termination

            class Nothing(Backend):
                name = "nothing"
                accepts = ErrorCorrectionRouting
                guarantee = Guarantee.HEURISTIC

                def run(self, problem, request):
                    return Answer(Termination.NO_SOLUTION)
            """
        )
    )
    info = tmp_path / "stranger-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        "[crosstrack.backends]\nnothing = stranger:Nothing\nbroken = no_such_module:Thing\n"
    )
    script = textwrap.dedent(
        """
        import crosstrack as ct
        states = {s.name: s for s in ct.backends()}
        assert states["nothing"].state == "installed"
        assert states["broken"].state == "broken" and "no_such_module" in states["broken"].cause
        model = ct.load("error-correction/example-1")
        assert {s.name: s.state for s in ct.backends(model)}["broken"] == "broken"
        assert ct.solve(model, "nothing").termination == "no_solution"
        verdict = ct.compare(model, ["label-setting", "nothing"], time_limit=20)
        assert [str(s.termination) for s in verdict.solutions] == ["optimal", "no_solution"], verdict
        assert ct.solve(model).backend == "label-setting"
        try:
            ct.solve(model, "broken")
        except ct.errors.BackendMissing:
            raise
        except ct.errors.BackendBroken as error:
            print("broken:", error)
        """
    )
    environment = {**os.environ, "PYTHONPATH": joined(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-"],
        input=script,
        capture_output=True,
        text=True,
        env=environment,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "broken: backend 'broken' (no_such_module:Thing) cannot be loaded" in done.stdout


def test_a_clash_of_libraries_moves_the_run_to_a_worker():
    """If a rival of a backend's library is loaded, the run moves to a worker automatically."""
    script = textwrap.dedent(
        """
        import sys
        import crosstrack as ct
        model = ct.load("error-correction/1")
        import ortools.math_opt.python.mathopt
        answer = ct.solve(model, "highs", time_limit=30)
        assert answer.termination == "optimal", answer
        assert "highspy" not in sys.modules
        print(answer.primal_bound)
        """
    )
    done = subprocess.run(
        [sys.executable, "-"], input=script, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr

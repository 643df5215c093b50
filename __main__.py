"""The command line: it parses, calls the public face and prints.

Exit codes: 0 verified; 1 internal error; 2 usage or bad data; 3 proven infeasible or unbounded;
4 no answer within limits, or an inconclusive comparison; 5 backend missing or broken; 6 verification
failed, or a contradiction; 130 interrupted with the incumbent kept.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

import crosstrack as ct
from crosstrack.errors import BackendBroken, BackendMissing, CrosstrackError
from crosstrack.instances.storage import read_plan, writable
from crosstrack.solvers.report.terminal import emit, progress, say, show

if TYPE_CHECKING:
    from crosstrack.models import Model
    from crosstrack.solvers import Solution
    from crosstrack.solvers.crosscheck import Comparison

VERIFIED, INTERNAL, USAGE, INFEASIBLE, NO_ANSWER, MISSING, VIOLATED = range(7)
INTERRUPTED = 130

_PLOT_SUFFIXES = (".png", ".pdf", ".svg")


# -- arguments ---------------------------------------------------------------------------------------


def pairs(values: Sequence[str], option: str) -> dict[str, Any]:
    """Return ``KEY=VALUE`` options as a mapping; a value that is JSON is read as such."""
    found: dict[str, Any] = {}
    for value in values:
        key, sign, text = value.partition("=")
        if not sign or not key:
            raise click.BadParameter(f"{value!r} is not KEY=VALUE", param_hint=option)
        try:
            found[key] = json.loads(text)
        except json.JSONDecodeError:
            found[key] = text
    return found


def picture_path(value: str | None) -> Path | None:
    """Return where a picture goes; a name that no picture has raises."""
    return None if value is None else writable(value, _PLOT_SUFFIXES)


def draw(model: Model[Any], plan: Any, path: Path, tolerance: float | None = None) -> None:
    """Write the picture of a plan or solution; `tolerance` is that of a plan held to another."""
    from crosstrack.models import ControlPlan

    # Other pictures judge a plan by no tolerance of their own.
    options = only(tolerance=tolerance) if isinstance(plan, ControlPlan) else {}
    ct.plot(model, plan, **options).savefig(path, dpi=150)
    say(f"picture: {path}")


_COMMON = [
    click.option("--formulation", help="Formulation for backends that take programs."),
    click.option("--time-limit", type=float, help="Seconds for a run, building included."),
    click.option("--gap", type=float, help="Relative gap at which an exact backend may stop."),
    click.option(
        "--tolerance", type=float, help="Largest violation accepted, relative to max(1, limit)."
    ),
    click.option("--seed", type=int, help="Seed for backends that draw."),
    click.option("--threads", type=int, help="Threads for backends that use several."),
    click.option("--warm-start", metavar="PLAN.json", help="A plan to start from; verified first."),
    click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output."),
]


def common(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that ``solve`` and ``compare`` share."""
    for option in reversed(_COMMON):
        command = option(command)
    return command


def only(**options: Any) -> dict[str, Any]:
    """Return the options that were given."""
    return {name: value for name, value in options.items() if value is not None}


# -- commands ----------------------------------------------------------------------------------------


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(ct.__version__, prog_name="crosstrack")
def cli() -> None:
    """Declare planning problems, solve them with any backend, cross-check every answer.

    INSTANCE is a catalogue name such as error-correction/7, or a JSON file.
    """


@cli.command()
@click.option("--probe", is_flag=True, help="Load each one in a worker to find what is broken.")
@click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
def backends(probe: bool, as_json: bool) -> int:
    """List the backends: installed or not, version, what they accept, guarantee, features."""
    from crosstrack.solvers.isolation import probe as probed
    from crosstrack.solvers.report.tables import table

    states = ct.backends()
    if probe:
        with progress("loading every backend"):
            states = probed(states)
    if as_json:
        emit([state.to_dict() for state in states])
        return VERIFIED
    rows = [
        (
            s.name,
            s.state,
            s.version or "",
            s.accepts,
            s.guarantee,
            ", ".join(s.features),
            s.cause or s.summary,
        )
        for s in states
    ]
    show(table("", ("backend", "state", "version", "accepts", "guarantee", "features", ""), rows))
    return VERIFIED


@cli.command()
@click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
def models(as_json: bool) -> int:
    """List the models with their formulations."""
    from crosstrack.models import model_type, model_types
    from crosstrack.solvers.report.tables import table

    found: list[dict[str, Any]] = []
    for kind in model_types():
        cls = model_type(kind)
        found.append(
            {
                "model": kind,
                "class": f"{cls.__module__}.{cls.__qualname__}",
                "formulations": {
                    name: cls.formulation_type(name).summary for name in cls.formulations
                },
                "default_formulation": cls.default_formulation or None,
                # None where each problem of the kind has its own.
                "objective_unit": cls.objective_unit
                if isinstance(cls.objective_unit, str)
                else None,
                "summary": (cls.__doc__ or "").strip().splitlines()[0],
            }
        )
    if as_json:
        emit(found)
    else:
        rows = [(f["model"], f["summary"], ", ".join(f["formulations"])) for f in found]
        show(table("", ("model", "", "formulations"), rows))
    return VERIFIED


@cli.command()
@click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
def instances(as_json: bool) -> int:
    """List the catalogue: papers, published figures, where the data comes from."""
    from crosstrack.instances import entries
    from crosstrack.solvers.report.tables import table

    found = entries()
    if as_json:
        emit([entry.to_dict() for entry in found])
    else:
        rows = [(e.name, e.model, e.provenance, e.title, e.note) for e in found]
        show(table("", ("instance", "model", "data", "", "note"), rows))
    return VERIFIED


@cli.command()
@click.argument("instance")
@click.option(
    "--backend", default="auto", show_default=True, help="A name from 'crosstrack backends'."
)
@common
@click.option(
    "--starts", type=int, default=1, show_default=True, help="Starts from different seeds."
)
@click.option(
    "--option",
    "options",
    multiple=True,
    metavar="KEY=VALUE",
    help="An option of the backend's own.",
)
@click.option(
    "--formulation-option",
    "formulation_options",
    multiple=True,
    metavar="KEY=VALUE",
    help="An option of the formulation.",
)
@click.option(
    "--isolate/--no-isolate", default=None, help="Run in a worker process, or in this one."
)
@click.option("--plot", metavar="FILE", help="Write a picture of the plan (png, pdf, svg).")
@click.option("--output", metavar="FILE", help="Write the solution as JSON.")
def solve(
    instance: str, backend: str, options: Sequence[str], formulation_options: Sequence[str], as_json: bool,
    plot: str | None, output: str | None, warm_start: str | None, starts: int, isolate: bool | None, **asked: Any,
) -> int:  # fmt: skip
    """Solve INSTANCE and verify the answer."""
    from crosstrack.instances.storage import write_text
    from crosstrack.solvers.report.tables import solutions_table, verification_table

    picture, record = picture_path(plot), None if output is None else writable(output)
    model = ct.load(instance)
    start = None if warm_start is None else read_plan(model, warm_start)
    with progress(f"{instance}: {backend}") as news:
        solution = ct.solve(
            model,
            backend,
            warm_start=start,
            starts=starts,
            isolate=isolate,
            on_incumbent=lambda i: news(f"incumbent {i.objective:.10g} after {i.seconds:.1f} s"),
            backend_options=pairs(options, "--option"),
            formulation_options=pairs(formulation_options, "--formulation-option"),
            **only(**asked),
        )
    if as_json:
        emit(solution.to_dict())
    else:
        show(solutions_table([solution], solution.instance))
        if solution.plan is not None:
            show(f"plan: {solution.plan}")
        if solution.verification is not None:
            show(verification_table(solution.verification))
        if solution.message:
            show(f"message: {solution.message}")
        if solution.termination in ("infeasible", "locally_infeasible"):
            show(f"crosstrack diagnose {instance} says why")
    if record is not None:
        write_text(record, solution.to_json(indent=2) + "\n")
    if picture is not None:
        if solution.plan is None:
            say("no plan, no picture")
        else:
            draw(model, solution, picture)
    return solve_code(solution)


def solve_code(solution: Solution[Any]) -> int:
    """Return the exit code for a solution."""
    if solution.limit == "interrupted":
        return INTERRUPTED
    if solution.plan is not None:
        return VERIFIED
    codes = {
        "infeasible": INFEASIBLE,
        "unbounded": INFEASIBLE,
        "rejected": VIOLATED,
        "failed": INTERNAL,
    }
    return codes.get(str(solution.termination), NO_ANSWER)


@cli.command()
@click.argument("instances", nargs=-1, required=True, metavar="INSTANCE...")
@click.option(
    "--backends",
    "names",
    help="Names separated by commas, each with :formulation where wanted; all that are installed and accept the first instance.",
)
@common
@click.option(
    "--grace",
    type=float,
    default=10.0,
    show_default=True,
    help="Seconds past the time limit before a worker is killed.",
)
@click.option("--workers", type=int, default=1, show_default=True, help="Jobs at the same time.")
@click.option(
    "--jsonl", metavar="FILE", help="Append every answer to FILE at once, one JSON line each."
)
@click.option("--resume", is_flag=True, help="Go on with FILE, running only what it lacks.")
def compare(
    instances: Sequence[str], names: str | None, as_json: bool, jsonl: str | None, resume: bool,
    warm_start: str | None, grace: float, workers: int, **asked: Any,
) -> int:  # fmt: skip
    """Solve every INSTANCE with several backends, one process each, and judge the answers."""
    from crosstrack.solvers.registry import fitting

    if resume and jsonl is None:
        raise click.UsageError("--resume needs --jsonl FILE")
    models = [ct.load(instance) for instance in instances]
    chosen = (
        [name.strip() for name in names.split(",") if name.strip()]
        if names
        else list(fitting(models[0]))
    )
    start = None if warm_start is None else [read_plan(model, warm_start) for model in models]
    total, count = len(models) * len(chosen), 0
    with progress(f"0 of {total}") as news:

        def ended(solution: Solution[Any]) -> None:
            nonlocal count
            count += 1
            news(
                f"{count} done, last: {solution.instance} {solution.backend} {solution.termination}"
            )

        result = ct.compare(
            models, chosen, record=jsonl, resume=resume, warm_start=start, grace=grace,
            workers=workers, on_solution=ended, **only(**asked),
        )  # fmt: skip
    if as_json:
        emit(result.to_dict())
    else:
        show(*result.parts())
    return compare_code(result)


def compare_code(result: Comparison) -> int:
    """Return the exit code for a comparison."""
    if result.interrupted:
        return INTERRUPTED
    return {"AGREED": VERIFIED, "CONTRADICTION": VIOLATED}.get(str(result.outcome), NO_ANSWER)


@cli.command()
@click.argument("instance")
@click.argument("plan", metavar="PLAN.json")
@click.option("--formulation", help="Check every row of this formulation as well.")
@click.option(
    "--tolerance", type=float, help="Largest violation accepted, relative to max(1, limit)."
)
@click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
@click.option("--plot", metavar="FILE", help="Write a picture of the plan (png, pdf, svg).")
def check(
    instance: str,
    plan: str,
    formulation: str | None,
    tolerance: float | None,
    as_json: bool,
    plot: str | None,
) -> int:
    """Verify somebody else's plan for INSTANCE: exit code 0 when it holds, 6 when it does not."""
    from crosstrack.solvers.report.tables import verification_table

    picture = picture_path(plot)
    model = ct.load(instance)
    found = read_plan(model, plan)
    verification = ct.verify(model, found, formulation=formulation, **only(tolerance=tolerance))
    if as_json:
        emit({"model": model.kind, "instance": model.name, "verification": verification.to_dict()})
    else:
        objective = (
            "" if verification.objective is None else f", objective {verification.objective:.10g}"
        )
        show(f"{model.name}: {'verified' if verification.ok else 'NOT verified'}{objective}")
        show(verification_table(verification))
    if picture is not None:
        draw(model, found, picture, tolerance)
    return VERIFIED if verification.ok else VIOLATED


@cli.command()
@click.argument("instance")
@click.argument("plan", metavar="PLAN.json")
@click.option(
    "--format",
    "form",
    type=click.Choice(["poly7", "samples", "bezier"]),
    default="poly7",
    show_default=True,
    help="Crazyflie's pieces (CSV), samples of all derivatives (CSV), Bézier points (JSON).",
)
@click.option("--output", metavar="FILE", required=True, help="The file to write.")
@click.option(
    "--rate", type=float, default=100.0, show_default=True, help="Samples a second, for samples."
)
@click.option(
    "--precision",
    type=click.Choice(["float32", "float64"]),
    default="float32",
    show_default=True,
    help="Digits of the numbers in poly7: the firmware's, or all.",
)
@click.option("--tolerance", type=float, help="Largest violation accepted (default 1e-6).")
@click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
def export(
    instance: str,
    plan: str,
    form: str,
    output: str,
    rate: float,
    precision: str,
    tolerance: float | None,
    as_json: bool,
) -> int:
    """Write the trajectory PLAN.json for INSTANCE as a file that other software flies.

    States and controls are written as samples, trajectories in any format. The plan is verified
    first: one that does not hold is not written (exit code 6).
    """
    from crosstrack.instances import (
        write_bezier,
        write_control_samples,
        write_poly7,
        write_samples,
    )
    from crosstrack.models import ControlPlan, Trajectory
    from crosstrack.solvers.report.tables import verification_table

    writable(output, (".json",) if form == "bezier" else (".csv",))
    model = ct.load(instance)
    found = read_plan(model, plan)
    if isinstance(found, ControlPlan):
        if form != "samples":
            raise click.UsageError(
                f"the plan of {instance} holds states and controls: write it with --format samples"
            )
    elif not isinstance(found, Trajectory):
        raise click.UsageError(f"{instance} has no trajectory: nothing to export")
    verification = ct.verify(model, found, **only(tolerance=tolerance))
    if not verification.ok:
        show(f"{model.name}: NOT verified, nothing written")
        show(verification_table(verification))
        return VIOLATED
    report: dict[str, Any] = {"format": form, "path": output}
    if form == "poly7":
        written = write_poly7(found, output, precision=precision)  # type: ignore[arg-type]
        report |= written.to_dict()
        text = str(written)
    else:
        if isinstance(found, ControlPlan):
            write_control_samples(found, output, rate=rate)
        elif form == "samples":
            write_samples(found, output, rate=rate)
        else:
            write_bezier(found, output)
        text = f"{output}: {found}"
    if as_json:
        emit(report)
    else:
        show(text)
    return VERIFIED


@cli.command()
@click.argument("instance")
@click.option("--backend", help="Filter the blocks of a program with this backend instead.")
@click.option("--formulation", help="The program whose rows are filtered (default: paper).")
@click.option(
    "--time-limit",
    type=float,
    default=60.0,
    show_default=True,
    help="Seconds for each program solved.",
)
@click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
def diagnose(
    instance: str, backend: str | None, formulation: str | None, time_limit: float, as_json: bool
) -> int:
    """Say why INSTANCE has no plan, in the paper's words (exit code 3), or that it has one (0)."""
    model = ct.load(instance)
    with progress(f"{instance}: looking for the reason"):
        found = ct.diagnose(model, backend, formulation=formulation, time_limit=time_limit)
    if as_json:
        emit(found.to_dict())
    else:
        show(str(found))
    return {True: VERIFIED, False: INFEASIBLE, None: NO_ANSWER}[found.feasible]


@cli.command()
@click.argument("problem")
@click.option("--rows", help="Instances to run, such as 1-6,9 (default: all).")
@click.option(
    "--time-limit", type=float, default=60.0, show_default=True, help="Seconds for each run."
)
@click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
def reproduce(problem: str, rows: str | None, time_limit: float, as_json: bool) -> int:
    """Print the paper's tables beside ours for PROBLEM, such as error-correction."""
    from crosstrack.instances import entries
    from crosstrack.solvers.report.reproduction import reproduce as beside, reproduction_parts

    found = [e for e in entries() if e.name.startswith(f"{problem}/") and "table" in e.published]
    if rows is not None:
        wanted = numbers(rows)
        found = [e for e in found if e.published["row"] in wanted]
        if not found:
            raise click.BadParameter(
                f"no row of {problem!r} is among {rows!r}", param_hint="--rows"
            )
    with progress(f"{problem}: ") as news:
        result = beside(
            problem,
            [(e.build(), e.published) for e in found],
            time_limit=time_limit,
            on_solution=lambda s: news(f"{s.instance} {s.backend} {s.termination}"),
        )
    if as_json:
        emit(result.to_dict())
    else:
        show(*reproduction_parts(result))
    return compare_code(result.comparison)


def numbers(text: str) -> set[int]:
    """Return the whole numbers that ``1-6,9`` names."""
    found: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.partition("-")
        try:
            found.update(range(int(first), int(last if dash else first) + 1))
        except ValueError:
            raise click.BadParameter(
                f"{part!r} is neither a number nor a range", param_hint="--rows"
            ) from None
    return found


@cli.command()
@click.option(
    "--points",
    metavar="FILE",
    help="A CSV with the columns id,x,y,z,kind instead of error-correction/7.",
)
@click.option(
    "--thresholds",
    default="20,10,15,20,20",
    show_default=True,
    help="alpha1,alpha2,beta1,beta2,theta for --points.",
)
@click.option(
    "--delta",
    type=float,
    default=0.001,
    show_default=True,
    help="Error gained per metre for --points.",
)
@click.option(
    "--time-limit", type=float, default=60.0, show_default=True, help="Seconds for each run."
)
@click.option(
    "--plot",
    metavar="FILE",
    default="crosstrack-demo.png",
    show_default=True,
    help="Where the picture goes.",
)
@click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
def demo(
    points: str | None, thresholds: str, delta: float, time_limit: float, plot: str, as_json: bool
) -> int:
    """Solve a 327-point route with every backend, print the verdict, draw the route."""
    from crosstrack.instances.error_correction import read_csv
    from crosstrack.solvers.crosscheck import rejudged
    from crosstrack.solvers.registry import find_backend, fitting

    picture = picture_path(plot)
    if points is None:
        model = ct.load("error-correction/7")
    else:
        values = [part.strip() for part in thresholds.split(",")]
        names = ("alpha1", "alpha2", "beta1", "beta2", "theta")
        try:
            given: dict[str, Any] = dict(zip(names, map(float, values), strict=True))
        except ValueError:
            raise click.BadParameter(
                f"{thresholds!r} must be five numbers: {','.join(names)}", param_hint="--thresholds"
            ) from None
        model = read_csv(points, **given, delta=delta)
    if not as_json:
        show(f"{model.name}: {model.describe()}", f"  digest {model.digest}")
    chosen = fitting(model)
    # Native first; their best plan then starts the programs' solvers.
    native = [name for name in chosen if isinstance(model, find_backend(name).accepts)]
    with progress("solving:") as news:

        def ended(solution: Solution[Any]) -> None:
            news(f"{solution.backend} {solution.termination}")

        first = ct.compare(model, native, time_limit=time_limit, on_solution=ended)
        programs = [name for name in chosen if name not in native]
        second = ct.compare(
            model,
            programs,
            time_limit=time_limit,
            warm_start=first.verdicts[0].best,
            on_solution=ended,
        )
    result = rejudged(model, first, second)
    if as_json:
        emit(result.to_dict())
    else:
        show(*result.parts())
    best = result.verdicts[0].best
    if best is not None:
        if not as_json:
            show(f"route by {best.backend}: {best.plan}")
        if picture is not None:
            draw(model, best, picture)
    return compare_code(result)


# -- the way out -------------------------------------------------------------------------------------


def fail(code: int, error: BaseException, as_json: bool) -> NoReturn:
    """Report an error on standard error, as JSON on standard output where that was asked, and exit."""
    if as_json:
        field = getattr(error, "field", None)
        emit({"error": {"type": type(error).__name__, "message": str(error), "field": field}})
    say(f"error: {error}")
    sys.exit(code)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with its code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    as_json = "--json" in arguments
    try:
        code = cli.main(arguments, prog_name="crosstrack", standalone_mode=False)
    except click.ClickException as error:
        if as_json:
            emit(
                {
                    "error": {
                        "type": type(error).__name__,
                        "message": error.format_message(),
                        "field": None,
                    }
                }
            )
        error.show()
        sys.exit(USAGE)
    except (BackendMissing, BackendBroken) as error:
        fail(MISSING, error, as_json)
    except CrosstrackError as error:
        fail(USAGE, error, as_json)
    except (KeyboardInterrupt, click.Abort):
        say("interrupted")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # The reader closed the pipe; Python must not try to flush into it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(INTERNAL)
    except Exception as error:
        traceback.print_exc()
        fail(INTERNAL, RuntimeError(f"internal error: {type(error).__name__}: {error}"), as_json)
    sys.exit(code if isinstance(code, int) else VERIFIED)


if __name__ == "__main__":
    main()

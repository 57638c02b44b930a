"""The matrix: controllers x plants x scenarios, so many trials of each, with the same seeds in each cell.

Cells of our own blocks run at native speed, those with FMUs of others by co-simulation. An FMU that fails
spoils its own cells: they say so, and the others are complete.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from harness.cosim.stepping import Limits
from harness.files import write_set
from harness.sweep.axis import SweepError
from harness.sweep.cells import Cells
from harness.sweep.chunks import ANOMALIES, FmuFailure, Job, Outcomes, Progress, program
from harness.sweep.components import Components, find_components
from harness.sweep.cosimulated import Cosimulated
from harness.sweep.paired import Comparison, compare
from harness.sweep.run import run_trials
from harness.sweep.table import Point, csv_of, table_of
from harness.sweep.tls import Certificates
from harness.sweep.trials import TRIAL_TYPES, Options, adapted, check_size, native_job, without
from harness.terminal import new_table, percent, print_table
from harness.trial import DEFAULT
from harness.trial.scenario import Scenario
from models.errors import CanineError, UsageError
from models.system import CONTROLLERS, PLANTS

MATRIX = "matrix"
CSV, PICTURE, PAGE, REPORT = "matrix.csv", "matrix.png", "matrix.html", "matrix.json"
COLUMNS = ("controller", "plant", "scenario")
OBEYING = tuple(name for name, block in PLANTS.items() if "command" in block.flat_names("input"))
ALPHA = 0.05  # share of matrices in which chance alone names a better controller
SHOWN = 12  # comparisons in the terminal
Name = tuple[str, str, str]  # controller, plant, scenario


@dataclass(frozen=True)
class Matrix:
    """A matrix, checked and resolved.

    Attributes:
        controllers, plants: as they were named.
        scenarios: with the options over them.
        cells: the names of all cells; `jobs`: those that can run, in the same order.
        refused: why the others cannot.
        trials: of each cell; `seed`: of the first.
        special: what differs from the matrix of these names alone.
        settings: `block.name=value`, which act in the cells that have the block.
    """

    controllers: tuple[str, ...]
    plants: tuple[str, ...]
    scenarios: tuple[Scenario, ...]
    cells: tuple[Name, ...]
    jobs: dict[Name, Job | Cosimulated]
    refused: dict[Name, str]
    trials: int
    seed: int
    special: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()

    @property
    def work(self) -> Cells:
        """The trials of all cells that can run."""
        return Cells(tuple(self.jobs.values()))

    @property
    def about(self) -> str:
        """The matrix in words."""
        counts = (
            (len(self.controllers), "controller"),
            (len(self.plants), "plant"),
            (len(self.scenarios), "scenario"),
        )
        words = " x ".join(f"{count} {what}{'s' * (count > 1)}" for count, what in counts)
        kinds = dict.fromkeys(f"{scenario.system}, {scenario.reading}" for scenario in self.scenarios)
        return f"{words}, {self.trials} trials a cell from seed {self.seed} on, {' and '.join(kinds)}"

    @property
    def identity(self) -> dict[str, Any]:
        """What tells the matrix from others, as matrix.json states it."""
        return {
            "controllers": list(self.controllers),
            "plants": list(self.plants),
            "scenarios": {scenario.name: tomllib.loads(scenario.text()) for scenario in self.scenarios},
            "trials": self.trials,
            "seed": self.seed,
        }

    @property
    def fingerprint(self) -> str:
        """A hash of everything that decides the results."""
        jobs = [[*name, asdict(job)] for name, job in self.jobs.items()]
        everything = json.dumps(
            [program(has_fmus=self.work.has_fmus), self.identity, jobs], sort_keys=True, default=str
        )
        return hashlib.sha256(everything.encode()).hexdigest()


def plan_matrix(
    controllers: Sequence[str] | None = None,
    plants: Sequence[str] | None = None,
    scenarios: Sequence[str | Scenario] = (DEFAULT,),
    *,
    trials: int = 1000,
    system: str | None = None,
    reading: str | None = None,
    seed: int | None = None,
    settings: Sequence[str] = (),
    estimator: str | None = None,
    ahrs: bool = False,
    limits: Limits = Limits(),  # noqa: B008 - it is frozen
    note: Callable[[str], None] = lambda text: None,
    built: Callable[[Path], None] = lambda path: None,
) -> Matrix:
    """Resolve the options of `canine matrix` to a matrix.

    Args:
        controllers, plants: of ours by name, or paths of FMUs; by default all of ours that obey commands.
        scenarios: their files or names; `two` and `three` stand for those of `canine sweep`.
        trials: of each cell.
        system, reading, estimator: override the scenarios'; the estimator may be an FMU.
        seed: of the first trial of each cell; by default the first scenario's.
        settings: `block.name=value`; one of a block in the matrix acts in the cells that have it.
        ahrs: put our AHRS between sensors and estimator of the system full.
        limits: for FMUs of others.
        note: called with a line for the user.
        built: called with each of our FMUs that had to be built.

    Raises:
        ScenarioError: a scenario or a setting is invalid.
        SweepError: a list is empty or names one twice, or the number of trials or seeds is invalid.
        UsageError: there is no such controller or plant.
    """
    controllers = list(CONTROLLERS) if controllers is None else controllers
    plants = OBEYING if plants is None else plants
    targets = [one for target in scenarios for one in _expanded(target)]
    for what, listed in (("controllers", controllers), ("plants", plants), ("scenarios", targets)):
        _check_list(what, [one.name if isinstance(one, Scenario) else one for one in listed])
    by_role = {
        "controller": {name: find_components(controller=name) for name in controllers},
        "plant": {name: find_components(plant=name) for name in plants},
    }
    own = find_components(estimator=estimator)
    options = Options(system, estimator, ahrs, reading, seed)
    base = [adapted(target, options, (), own) for target in targets]
    _check_list("scenarios", [scenario.name for scenario in base])
    first_seed = base[0].seed
    base = [replace(scenario, seed=first_seed) for scenario in base]
    names: list[Name] = list(product(controllers, plants, [scenario.name for scenario in base]))
    jobs: dict[Name, Job | Cosimulated] = {}
    refused: dict[Name, str] = {}
    notes: dict[str, None] = {}  # in order, each once

    def collect(text: str) -> None:
        notes[text] = None

    blocks = {c.block(role) for role, known in by_role.items() for c in known.values()} - {None}
    for controller, plant, scenario in product(controllers, plants, base):
        name = (controller, plant, scenario.name)
        chosen = own | by_role["controller"][controller] | by_role["plant"][plant]
        others = blocks - {chosen.block("controller"), chosen.block("plant")}
        cell = scenario.override(without(settings, others), swaps=chosen.blocks)
        try:
            jobs[name] = _job(cell, chosen, trials, limits, note=collect, built=built)
        except UsageError:
            raise
        except CanineError as reason:
            refused[name] = "; ".join(str(reason).splitlines())
    for text in notes:
        note(text)
    reasons = dict.fromkeys(refused.values())
    if not jobs:
        raise CanineError("\n".join(reasons))
    for why in reasons:
        cells = "; ".join(", ".join(name) for name, text in refused.items() if text == why)
        note(f"{cells}: left out; {why}")
    check_size(Cells(tuple(jobs.values())), first_seed)
    special = (
        *([reading] if reading else []),
        *([system] if system else []),
        *([estimator] if estimator else []),
        *(["ahrs"] if ahrs else []),
        *([f"seed{seed}"] if seed is not None else []),
    )
    return Matrix(
        tuple(controllers),
        tuple(plants),
        tuple(base),
        tuple(names),
        jobs,
        refused,
        trials,
        first_seed,
        special,
        tuple(settings),
    )


def _expanded(target: str | Scenario) -> tuple[str | Scenario, ...]:
    return (target,) if isinstance(target, Scenario) else TRIAL_TYPES.get(target, (target,))


def _check_list(what: str, names: Sequence[str]) -> None:
    if not names:
        raise SweepError(f"{what} is empty; expected one name at least")
    if not all(names):
        raise SweepError(f"{what}: has an empty name; leave it out")
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise SweepError(f"{what}: {twice} is named twice")


def _job(
    scenario: Scenario,
    components: Components,
    trials: int,
    limits: Limits,
    *,
    note: Callable[[str], None],
    built: Callable[[Path], None],
) -> Job | Cosimulated:
    """The trials of a cell.

    Raises:
        CanineError: an FMU cannot be read, or does not fit.
    """
    if components.foreign:
        cell = Cosimulated((scenario,), components.swaps, trials, scenario.seed, limits)
        with cell.ready(scenario, built) as ready:
            for text in ready.notes:
                note(text)
        return cell
    return native_job([scenario], components, (), trials, note)


def default_folder(matrix: Matrix) -> Path:
    """The folder of the results by default."""
    name = "-".join(("matrix", *(Path(part).stem for part in matrix.special)))
    return Path("out") / name


@dataclass(frozen=True)
class Result:
    """The results of a matrix.

    Attributes:
        table: a row for each cell that could run, by its name.
        comparisons: of two controllers that led the same plant through the same scenario: their names,
            plant and scenario.
        better: for each comparison the controller that is shown to succeed more often; "" for none.
    """

    matrix: Matrix
    table: dict[Name, Point]
    comparisons: dict[tuple[str, str, str, str], Comparison]

    @property
    def better(self) -> dict[tuple[str, str, str, str], str]:
        """The better controller of each comparison, at 5 % over all of them (Bonferroni); "" for none."""
        limit = ALPHA / max(1, len(self.comparisons))
        return {
            key: "" if c.p_value > limit else key[0] if c.only_first > c.only_second else key[1]
            for key, c in self.comparisons.items()
        }

    def verdict(self, name: Name) -> str:
        """What FMUs did to a cell, or why it could not run; "" if nothing is wrong."""
        return self.table[name].verdict if name in self.table else self.matrix.refused[name]

    def fmu_failures(self, refused: str = "") -> list[str]:
        """The verdicts of all cells with one, each with the cell's name.

        Args:
            refused: what is said of a cell that cannot run; by default why.
        """
        verdicts = {name: self.verdict(name) for name in self.matrix.cells}
        if refused:
            verdicts |= dict.fromkeys(self.matrix.refused, refused)
        return [f"{', '.join(name)}: {verdict}" for name, verdict in verdicts.items() if verdict]

    def facts(self) -> dict[str, Any]:
        """The content of matrix.json."""
        better = self.better
        return {
            **self.matrix.identity,
            "cells": [self._cell(name) for name in self.matrix.cells],
            "comparisons": [
                {
                    "first": first, "second": second, "plant": plant, "scenario": scenario,
                    **comparison.facts(), "better": better[first, second, plant, scenario] or None,
                }
                for (first, second, plant, scenario), comparison in self.comparisons.items()
            ],
        }  # fmt: skip

    def _cell(self, name: Name) -> dict[str, Any]:
        facts: dict[str, Any] = dict(zip(COLUMNS, name, strict=True))
        point = self.table.get(name)
        if point is not None:
            low, high = point.interval
            facts |= {
                "trials": point.trials, "successes": point.successes, "success_rate": point.success_rate,
                "ci_low": low, "ci_high": high, "mean_time_s": point.mean_time, "sd_time_s": point.sd_time,
                "mean_commands": point.mean_commands, "timeouts": point.timeouts,
                "anomalies": dict(point.anomalies),
                "fmu_failures": [self._failure(failure) for failure in point.fmu_failures],
            }  # fmt: skip
        else:
            facts |= {"trials": 0, "fmu_failures": []}
        return facts | {"verdict": self.verdict(name) or None}

    def _failure(self, failure: FmuFailure) -> dict[str, Any]:
        seed = self.matrix.seed + failure.number
        return {"number": failure.number, "seed": seed, **asdict(failure.fault), "text": failure.text}

    def csv(self) -> bytes:
        """The content of matrix.csv; a cell that could not run has its verdict only."""
        rows = [
            self.table.get(name)
            or Point((), 0, 0, 0, 0, 0, 0, dict.fromkeys(ANOMALIES, 0), {}, refused=self.verdict(name))
            for name in self.matrix.cells
        ]
        return csv_of(COLUMNS, self.matrix.cells, rows, has_fmus=True)


def run(
    matrix: Matrix,
    folder: Path,
    address: str | None = None,
    *,
    certificates: Certificates = Certificates(),  # noqa: B008 - it is frozen
    progress: Progress | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> Result:
    """Run the trials that the folder's journal lacks, and write matrix.csv, .json, .png and .html.

    Args:
        address, certificates, progress, note: as of `sweep.run`.

    Raises:
        UsageError: the folder is in use, a folder has the name of a result, or no scheduler answers.
        CanineError: a fault that is not an FMU's; the chunks done before are kept.
        KeyboardInterrupt: the user ended it; the chunks done before are kept.
    """

    def report(outcomes: Outcomes) -> Result:
        from harness.sweep.matrix_plots import matrix_png  # noqa: PLC0415 - matplotlib
        from harness.sweep.page import matrix_page  # noqa: PLC0415 - jinja2

        result = result_of(matrix, outcomes)
        text = json.dumps(result.facts(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        picture = matrix_png(result)
        page = matrix_page(result, outcomes, comparison_texts(result))
        write_set(folder, {CSV: result.csv(), PICTURE: picture, PAGE: page, REPORT: text.encode()})
        return result

    return run_trials(
        matrix,
        folder,
        report,
        address,
        what=MATRIX,
        files=(CSV, PICTURE, PAGE, REPORT),
        certificates=certificates,
        progress=progress,
        note=note,
    )


def result_of(matrix: Matrix, outcomes: Outcomes) -> Result:
    """The results, from the outcomes of `matrix.work`."""
    places = {name: index for index, name in enumerate(matrix.jobs)}
    table = dict(zip(matrix.jobs, table_of([()] * len(places), outcomes), strict=True))
    comparisons = {}
    for plant, scenario in product(matrix.plants, (scenario.name for scenario in matrix.scenarios)):
        for first, second in combinations(matrix.controllers, 2):
            cells = (first, plant, scenario), (second, plant, scenario)
            if all(cell in places for cell in cells):
                a, b = (outcomes.ticks[places[cell]][: table[cell].trials] for cell in cells)
                ended = {failure.number for cell in cells for failure in table[cell].fmu_failures}
                comparisons[first, second, plant, scenario] = compare(a, b, ended)
    return Result(matrix, table, comparisons)


def show(result: Result, console: Console) -> None:
    """Print the table, and which controllers are shown to be better."""
    printed = new_table(*COLUMNS)
    for heading in ("trials", "success", "95 % interval", "time [s]", "commands", "timeouts", "FMU failures"):
        printed.add_column(escape(heading), justify="right")
    for name in result.matrix.cells:
        point = result.table.get(name)
        if point is None:
            printed.add_row(*map(escape, name), "0", *["-"] * 5, "refused")
            continue
        low, high = point.interval
        means = (point.mean_time, point.mean_commands)
        printed.add_row(
            *map(escape, name),
            str(point.trials),
            percent(point.success_rate),
            f"{100 * low:.1f}-{100 * high:.1f}",
            *("-" if mean is None else f"{mean:.2f}" for mean in means),
            str(point.timeouts),
            str(len(point.fmu_failures)),
        )
    print_table(printed, console)
    for text in comparison_texts(result)[:SHOWN]:
        console.print(escape(text), soft_wrap=True)
    if len(result.comparisons) > SHOWN:
        console.print(f"all {len(result.comparisons)} comparisons are in {REPORT}", style="dim")


def comparison_texts(result: Result) -> list[str]:
    """The comparisons in words, those that show a difference first."""
    better = result.better
    texts = []
    for key, comparison in sorted(result.comparisons.items(), key=lambda item: item[1].p_value):
        first, second, plant, scenario = key
        if comparison.difference is None or comparison.ci_low is None or comparison.ci_high is None:
            texts.append(f"{scenario}, {plant}: {first} and {second} have no trials to compare")
            continue
        sign = -1 if better[key] == second else 1
        a, b = (second, first) if sign < 0 else (first, second)
        low, high = sorted((sign * comparison.ci_low, sign * comparison.ci_high))
        how = "succeeds more often than" if better[key] else "is not shown to differ from"
        texts.append(
            f"{scenario}, {plant}: {a} {how} {b}: {100 * sign * comparison.difference:+.1f} points "
            f"({100 * low:+.1f} to {100 * high:+.1f}, {comparison.pairs} trials paired by seed)"
        )
    return texts

"""A matrix beside its peers: the same trials one by one over FMUs, and a worker for each trial."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from harness.cosim.loop import Simulation
from harness.cosim.stepping import Limits
from harness.sweep.cosimulated import Cosimulated, ForeignFmu, begin
from harness.sweep.matrix import Matrix, plan_matrix, run
from harness.trial.prepare import prepared
from harness.trial.request import Changes, requested
from harness.trial.scenario import load
from harness.trial.trial import stop_of
from tests.bench.sweeps import Row, seconds_of
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

CONTROLLERS, PLANTS, TRIALS = ["cmec", "quarter_turn"], ["canine", "pedestrian"], 1000
ONE_BY_ONE, IN_WORKER = 5, 10  # trials of each cell by the peer; trials of an FMU made elsewhere
LONGEST, ONE_WORKER = 60.0, 3.0  # expected: s of the matrix; what one worker gains
DOG = [V("command", "input", "Integer"), *(V(n, unit=u) for n, u in (("north", "m"), ("east", "m")))]
DOG += [V("heading", unit="rad"), V("speed", unit="m/s")]


def rows() -> tuple[list[Row], list[str]]:
    """The table's rows, and the results that fall short of what is expected."""
    planned = plan_matrix(CONTROLLERS, PLANTS, trials=TRIALS)
    with tempfile.TemporaryDirectory() as folder:
        run(planned, Path(folder) / "compiled")
        ours = seconds_of(lambda: run(planned, Path(folder) / "timed"))
        one, each = in_workers(Path(folder))
    peer = one_by_one(planned) * len(planned.cells) * TRIALS
    table = [
        (
            f"a matrix of 2 x 2 with {TRIALS:,} trials a cell, against one trial after the other over FMUs",
            f"{ours:.2f} s",
            f"{peer:.0f} s (from {ONE_BY_ONE} trials a cell)",
            f"{peer / ours:.0f}",
        ),
        (
            "trials with an FMU made elsewhere in one worker, against a worker for each",
            f"{one:.3f} s/trial",
            f"{each:.3f} s/trial",
            f"{each / one:.1f}",
        ),
    ]
    short = []
    if ours > LONGEST:
        short.append(f"a matrix of 2 x 2 takes {ours:.0f} s; expected {LONGEST:.0f}")
    if each / one < ONE_WORKER:
        short.append(f"one worker is {each / one:.2f} times as fast as one for each; expected {ONE_WORKER}")
    return table, short


def one_by_one(planned: Matrix) -> float:
    """Seconds of a trial over FMUs in this process, without a log."""

    def trials() -> None:
        for controller, plant, _ in planned.cells:
            changes = Changes(swaps={"controller": controller, "plant": plant})
            with requested(planned.scenarios[0], changes) as request, prepared(request) as ready:
                for seed in range(1, ONE_BY_ONE + 1):
                    one = ready.planned(replace(request.scenario, seed=seed))
                    with Simulation(one.system, one.plan.values, plants=one.plants) as simulation:
                        simulation.run(one.plan.events, stop=stop_of(simulation))

    return seconds_of(trials) / (len(planned.cells) * ONE_BY_ONE)


def in_workers(folder: Path) -> tuple[float, float]:
    """Seconds of a trial with an FMU made elsewhere: many in a worker, one in each."""
    dog = ForeignFmu.of(tiny_fmu(folder / "dog.fmu", DOG, "v[4] = v[0] == 1 ? 5 : 0; v[1] += v[4] * h;"))
    cell = Cosimulated((load("two_waypoint"),), {"plant": dog}, IN_WORKER, 1, Limits())
    begin()
    one = seconds_of(lambda: cell.run(0, IN_WORKER))
    each = seconds_of(lambda: [cell.run(number, number + 1) for number in range(IN_WORKER)])
    return one / IN_WORKER, each / IN_WORKER

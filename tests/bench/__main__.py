"""`make bench`: each figure beside its peer's, in turns within one run, because machines are noisy."""

from __future__ import annotations

from collections.abc import Callable

import fmpy.fmi2

from fmus.build import build_all
from harness.cosim.loop import Simulation
from harness.cosim.stepping import Loop
from harness.terminal import console_of, new_table, print_table
from harness.trial.prepare import Prepared, prepared
from harness.trial.request import Changes, requested
from models.kit.timing import TICK
from models.system import SYSTEMS
from tests.bench import estimators, logs, masters, matrices, routes, startup, sweeps
from tests.bench.timing import paired, timed

TICKS = 891  # of the trial that is timed: three_waypoint, seed 1
MANY_TICKS = 20_000  # of the same system, for the loop in C beside Python's
DEMAND = 2.5  # what the loop must be faster than fmpy's wrappers


class Wrapped:
    """The full system stepped through fmpy's call wrappers: what a straightforward master does."""

    def __init__(self, ready: Prepared) -> None:
        self.system = SYSTEMS["full"]
        self.slaves: dict[str, fmpy.fmi2.FMU2Slave] = {}
        self.links: dict[str, dict[str, tuple[list[int], list[tuple[str, int]]]]] = {}
        self.outputs: dict[str, dict[str, list[int]]] = {}
        references: dict[tuple[str, str], tuple[int, str]] = {}
        for name, part in ready.system.components.items():
            description = fmpy.read_model_description(part.fmu)
            slave = fmpy.fmi2.FMU2Slave(
                guid=description.guid,
                unzipDirectory=fmpy.extract(part.fmu),
                modelIdentifier=description.coSimulation.modelIdentifier,
            )
            slave.instantiate()
            slave.setupExperiment(startTime=0.0)
            self.slaves[name] = slave
            kinds: dict[str, list[int]] = {}
            for variable in description.modelVariables:
                references[name, variable.name] = (variable.valueReference, variable.type)
                if variable.causality == "output":
                    kinds.setdefault(variable.type, []).append(variable.valueReference)
            self.outputs[name] = kinds
            for variable_name, value in ready.plan.values.get(name, {}).items():
                reference, kind = references[name, variable_name]
                self.setter(slave, kind)([reference], [value if kind == "Real" else int(value)])
            slave.enterInitializationMode()
            slave.exitInitializationMode()
        for name in self.slaves:
            by_kind: dict[str, tuple[list[int], list[tuple[str, int]]]] = {}
            for link in self.system.links:
                if link.target == name:
                    reference, kind = references[name, link.target_variable]
                    targets, sources = by_kind.setdefault(kind, ([], []))
                    targets.append(reference)
                    sources.append((link.source, references[link.source, link.source_variable][0]))
            self.links[name] = by_kind
        self.values: dict[tuple[str, int], float] = {}

    @staticmethod
    def setter(slave: fmpy.fmi2.FMU2Slave, kind: str) -> Callable[[list[int], list[float]], None]:
        setters: dict[str, Callable[[list[int], list[float]], None]] = {
            "Real": slave.setReal, "Integer": slave.setInteger, "Boolean": slave.setBoolean
        }  # fmt: skip
        return setters[kind]

    @staticmethod
    def getter(slave: fmpy.fmi2.FMU2Slave, kind: str) -> Callable[[list[int]], list[float]]:
        getters: dict[str, Callable[[list[int]], list[float]]] = {
            "Real": slave.getReal, "Integer": slave.getInteger, "Boolean": slave.getBoolean
        }  # fmt: skip
        return getters[kind]

    def collect(self, name: str) -> None:
        for kind, references in self.outputs[name].items():
            values = self.getter(self.slaves[name], kind)(references)
            self.values.update({(name, r): v for r, v in zip(references, values, strict=True)})

    def run(self, ticks: int) -> None:
        order = self.system.order()
        self.collect("plant")
        for tick in range(ticks):
            for name in order:
                for kind, (targets, sources) in self.links[name].items():
                    self.setter(self.slaves[name], kind)(targets, [self.values[s] for s in sources])
                self.slaves[name].doStep(tick * TICK, TICK)
                self.collect(name)

    def close(self) -> None:
        for slave in self.slaves.values():
            slave.terminate()
            slave.freeInstance()


def looped(ready: Prepared, ticks: int, loop: Loop = "native") -> float:
    """Seconds for ticks of the trial's system, without a log."""
    with Simulation(ready.system, ready.plan.values, loop=loop) as simulation:
        return timed(lambda: simulation.run(ready.plan.events, duration=(ticks - 1) * TICK))


def loop_against_wrappers(ready: Prepared) -> tuple[float, float, float]:
    """Seconds for the trial's ticks: our loop, the same loop through fmpy's wrappers."""

    def wrappers() -> float:
        master = Wrapped(ready)
        try:
            return timed(lambda: master.run(TICKS))
        finally:
            master.close()

    return paired(lambda: looped(ready, TICKS), wrappers)


def main() -> None:
    console = console_of()
    build_all()
    table = new_table("figure", "ours", "peer", "peer / ours", gap=3)
    with requested("three_waypoint", Changes()) as request, prepared(request) as ready:
        ours, wrappers, ratio = loop_against_wrappers(ready)
        native, python, native_ratio = paired(
            lambda: looped(ready, MANY_TICKS), lambda: looped(ready, MANY_TICKS, "python"), rounds=5
        )
        logged, by_rows, log_ratio = paired(
            lambda: logs.with_log(request, ready, TICKS), lambda: logs.row_by_row(ready, TICKS)
        )
    table.add_row(
        "loop over 5 FMUs, against fmpy's call wrappers",
        f"{ours / TICKS * 1e6:.1f} us/tick",
        f"{wrappers / TICKS * 1e6:.1f} us/tick",
        f"{ratio:.1f}",
    )
    table.add_row(
        "loop in C without the log, against Python's",
        f"{MANY_TICKS / native:,.0f} ticks/s",
        f"{MANY_TICKS / python:,.0f} ticks/s",
        f"{native_ratio:.1f}",
    )
    table.add_row(
        "loop with the log, against json and mcap row by row",
        f"{TICKS / logged:,.0f} ticks/s",
        f"{TICKS / by_rows:,.0f} ticks/s",
        f"{log_ratio:.1f}",
    )
    for row in masters.rows():
        table.add_row(*row)
    short: list[str] = []
    for part in (estimators, sweeps, routes, matrices, startup):
        rows, shortfalls = part.rows()
        short += shortfalls
        for row in rows:
            table.add_row(*row)
    print_table(table, console)
    if ratio < DEMAND:
        short.append(f"the loop is {ratio:.2f} times as fast as fmpy's call wrappers; expected {DEMAND}")
    if short:
        raise SystemExit("\n".join(short))


if __name__ == "__main__":
    main()

"""The processor in the loop: the firmware on a simulated processor against this machine's, bit by bit.

A whole trial is run with the simulated processor in the closed loop. This machine's gets the same bytes, and
after every tick all that both remember, play and send is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from codegen.firmware.bundle import recorded
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.targets import SIMULATED, find_in_the_loop, find_target
from harness.files import make_folder
from harness.onboard.processors import Cost, Processor, ProcessorError, Received, Reply, open_processor
from harness.pil import SCENARIO
from harness.pil.printed_defuzzifier import printed_defuzzifier_clocks
from harness.terminal import new_table, print_table
from harness.trial import trial
from harness.trial.instances import is_foreign
from harness.trial.prepare import prepared
from harness.trial.request import Changes, build_missing, requested
from harness.trial.summary import write_summary
from models.errors import UsageError
from models.kit.block import Block
from models.kit.declaration import Type
from models.kit.link import Values

REPORT = "pil.json"
TICK_MS = 1e3 * Block.sample_time
CLOCK_MHZ = {"rabbit4000": 58.98}  # of the RCM4100
WAIT_STATES = range(5)


class DifferenceError(ProcessorError):
    """Two processors that run the same program differ."""


@dataclass
class Compared:
    """A processor, watched: this machine's makes the same ticks, and each is compared.

    Attributes:
        costs: of each tick, and whether it had a fix.
        navigation: of the program.
        most_stack: bytes, once it is closed.
    """

    target: str
    processor: Processor
    host: Processor
    costs: list[tuple[Cost, bool]] = field(default_factory=list)
    navigation: Navigation = DEFAULT
    ticks: int = 0
    most_stack: int | None = None

    def __post_init__(self) -> None:
        self.image, self.start = self.processor.image, self.processor.start
        self._compare_records(self.start, self.host.start, "before the first tick")

    def tick(self, received: Received) -> Reply:
        """One tick of both.

        Raises:
            DifferenceError: naming tick, word and both values.
        """
        reply, expected = self.processor.tick(received), self.host.tick(received)
        when = f"on tick {self.ticks}"
        self._compare_records(reply.record, expected.record, when)
        for name in ("sent", "tone_hz", "vibrate_left", "vibrate_right"):
            got, ours = getattr(reply, name), getattr(expected, name)
            if got != ours:
                raise DifferenceError(f"{self.target}: {name} is {got!r} {when}, on the host {ours!r}")
        self.ticks += 1
        if reply.cost is not None:
            self.costs.append((reply.cost, bool(received.gps)))
        return reply

    def _compare_records(self, record: bytes, expected: bytes, when: str) -> None:
        if record == expected:
            return
        got, ours = (np.frombuffer(x, "<u4") for x in (record, expected))
        if len(got) != len(ours):
            raise DifferenceError(f"{self.target}: {len(got)} words {when}, on the host {len(ours)}")
        index = int(np.flatnonzero(got != ours)[0])
        name, kind = list(recorded(self.navigation).items())[index]
        there, here = (_word(words[index], kind) for words in (got, ours))
        raise DifferenceError(f"{self.target}: {name} is {there} {when}, on the host {here}")

    def stack(self) -> int | None:
        """Most bytes of stack on the simulated processor."""
        return self.processor.stack()

    def close(self) -> None:
        """Close both; the measurements stay."""
        try:
            self.most_stack = self.stack()
        finally:
            self.processor.close()
            self.host.close()


def _word(word: np.uint32, kind: Type) -> str:
    if kind is Type.REAL:
        return f"{np.array([word], '<u4').view('<f4')[0]!s} (0x{word:08x})"
    return str(np.array([word], "<u4").view("<i4")[0])


def run(
    target: str,
    scenario: str,
    changes: Changes,
    out: Path | None,
    *,
    constants: bool = False,
    built: Callable[[Path], None] = lambda path: None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Run a trial on a simulated processor and on this one; its cost.

    Args:
        scenario: as for `canine run`.
        constants: the firmware's parameters are constants.
        built, progress: called with each FMU that is built, and with the trial's time.

    Raises:
        UsageError: the target is not simulated, or the scenario does not fit it.
        DifferenceError: the processors differ.
        CanineError: the trial fails for another reason.
    """
    find_in_the_loop(target)
    if target not in SIMULATED:
        raise UsageError(f'--target "{target}": expected a simulated one: {", ".join(SIMULATED)}')
    watched: list[Compared] = []

    def start(name: str, values: Values, navigation: Navigation) -> Processor:
        with ExitStack() as opened:
            processor = open_processor(name, values, navigation, constants=constants)
            opened.callback(processor.close)
            host = open_processor("host", values, navigation, constants=constants)
            opened.callback(host.close)
            watched.append(Compared(name, processor, host, navigation=navigation))
            opened.pop_all()
        return watched[-1]

    with requested(scenario, replace(changes, onboard=f"pil:{target}")) as request:
        build_missing(request, built)
        if is_foreign(request):
            raise UsageError(
                f"{scenario}: has an FMU that was not built here, beside which processors are not compared; "
                f"`canine run {scenario} --onboard pil:{target}` runs it"
            )
        with prepared(request) as ready:
            place = out or default_folder(target, changes)
            make_folder(place)
            (place / REPORT).unlink(missing_ok=True)  # of an earlier run
            summary = trial.run(request, ready, place, progress, start)
    result = report(target, watched[0]) | {"trial": summary}
    if target == "rabbit4000":
        clocks = max(clocks for _, clocks in printed_defuzzifier_clocks())
        result["printed_defuzzifier"] = {"clocks": clocks, "ms": _ms(target, clocks)}
    write_summary(result, place / REPORT)
    return result


def default_folder(target: str, changes: Changes) -> Path:
    """The folder for the files without --out."""
    parts = ["pil", target, changes.estimator, "ahrs" if changes.ahrs else None]
    return Path("out") / "-".join(filter(None, parts))


def report(target: str, watched: Compared) -> dict[str, Any]:
    """The costs of the ticks and the bytes of the program, as JSON."""
    footprint = watched.image.footprint
    figures: dict[str, Any] = {
        "target": target,
        "estimator": watched.navigation.name,
        "receiver": "NAV-PVT" if find_target(target).pvt else "NAV-POSLLH, NAV-SOL, NAV-VELNED",
        "ticks": len(watched.costs),
        "identical": True,
        "without_fix": _costs(target, [cost for cost, fix in watched.costs if not fix]),
        "with_fix": _costs(target, [cost for cost, fix in watched.costs if fix]),
        "stack_bytes": watched.most_stack,
    }
    if footprint is not None:
        figures |= {f"{name}_bytes": getattr(footprint, name) for name in ("code", "constants", "ram")}
    return figures


def _costs(target: str, costs: Iterable[Cost]) -> dict[str, Any]:
    """Worst and mean over the ticks; where clocks are known, also the worst in ms by wait states."""
    costs = list(costs)
    if not costs:
        return {"ticks": 0}
    kinds = ("instructions", "clocks", "accesses") if costs[0].clocks else ("instructions",)
    figures: dict[str, Any] = {"ticks": len(costs)}
    for kind in kinds:
        values = [getattr(cost, kind) for cost in costs]
        figures[kind] = {"worst": max(values), "mean": round(float(np.mean(values)))}
    if costs[0].clocks:
        figures["worst_ms_by_wait_states"] = [
            _ms(target, max(c.clocks + w * c.accesses for c in costs)) for w in WAIT_STATES
        ]
    return figures


def _ms(target: str, clocks: int) -> float:
    return round(clocks / CLOCK_MHZ[target] / 1e3, 2)


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print it as a table."""
    trial_ = result["trial"]
    console.print(
        f"{result['target']}, {result['estimator']}: {result['ticks']} ticks of {trial_['scenario']}, "
        f"seed {trial_['seed']} ({trial_['outcome']}, {trial_['time_s']:.2f} s): "
        f"every bit as on this machine; fixes as {result['receiver']}",
        soft_wrap=True,
    )
    table = new_table("", "worst", "mean")
    for key, label in (("without_fix", "tick without a fix"), ("with_fix", "tick with a fix")):
        for kind in ("clocks", "accesses", "instructions"):
            if kind in result[key]:
                cost = result[key][kind]
                table.add_row(f"{label}, {kind}", f"{cost['worst']:,}", f"{cost['mean']:,}")
        if times := result[key].get("worst_ms_by_wait_states"):
            spread = ", ".join(f"{t:.2f}" for t in times)
            table.add_row(f"{label}, ms of {TICK_MS:g} at 0 to 4 wait states", spread, "")
    if printed := result.get("printed_defuzzifier"):
        label = "the defuzzifier alone, as the dissertation prints it, clocks (ms)"
        table.add_row(label, f"{printed['clocks']:,} ({printed['ms']:g})", "")
    for key in ("code_bytes", "constants_bytes", "ram_bytes", "stack_bytes"):
        if result.get(key) is not None:
            table.add_row(key.replace("_", ", "), f"{result[key]:,}", "")
    print_table(table, console)


def costs(target: str, out: Path, estimator: str | None = None, *, ahrs: bool = False) -> dict[str, Any]:
    """The figures in the bundle's README: those of the standard trial."""
    result = run(target, SCENARIO, Changes(estimator=estimator, ahrs=ahrs), out)
    summary = result.pop("trial")
    return result | {"scenario": summary["scenario"], "seed": summary["seed"]}

"""Proofs of the C that ships, by the model checker CBMC: what each shows, and what it takes for granted.

Their sources are in `proofs/`: `unit.name` is the function `prove_name` of `prove_unit.c`. CBMC follows every
path for every value that a proof leaves open. Those of the unit `graph` are about the controller's model, by
the solver z3 (graph.py).
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from codegen.blocks.block_c import write_files
from codegen.firmware import graph
from codegen.firmware.bundle import library
from codegen.toolchains import cbmc
from models.errors import UsageError

SOURCES = Path(__file__).parent / "proofs"
# checks beside CBMC's own (bounds, pointers, signed overflow, division by zero, shifts)
MEMORY = ("--pointer-overflow-check", "--enum-range-check")
NUMBERS = ("--nan-check", "--float-overflow-check", "--float-div-by-zero-check", "--conversion-check")
BOTH = (*MEMORY, *NUMBERS)
SHORT_INT = ("-Iint16", "--16")  # the int of C has 16 bits, as on the Rabbit 4000
TIMEOUT = 300.0  # s, at most, for one

RULE = ("--no-standard-checks",)  # controller.tick and cmec.step have them
# what proofs take for granted
SHIPPED = "parameters as the firmware ships"
AIMING = "any drift, response time and braking to aim off by, with any effect on where turns and runs end"
AIMED = "distance is within [0, 1e6] m, deviation within [-3.2, 3.2] rad, as cmec.aim shows"
STATE = "a state as controller.start and controller.tick show it"
EXACT = "tones and vibration of less than seven days since power-up"
NO_RECALL = "`fence_recall` is off, as shipped"
YOUNG = "no counter has reached 2e9: two and a half years of ticks"
MISSION = "home and waypoints lie within 100 km of the origin"
TAG = "the tag of a frame is any, but one: SipHash-2-4 itself is tested"
SCANNER = "the scanner gives frames of the protocol's length, as scanner.search shows"
ROOT = "sqrtf gives a value of 0 or more, up to a bound, for 0 or more"


@dataclass(frozen=True)
class Proof:
    """One proof.

    Attributes:
        name: unit and function.
        claim: what holds.
        rule: of models/SAFETY.md, if it is one of these.
        loops: how often loops are followed; that they end by then is shown too.
        checks: options of CBMC.
        assumes: what is taken for granted.
        long: tens of seconds.
        short: shown with an int of 16 bits too.
    """

    name: str
    claim: str
    rule: int | None = None
    loops: int = 1
    checks: tuple[str, ...] = MEMORY
    assumes: tuple[str, ...] = ()
    long: bool = False
    short: bool = False

    @property
    def tool(self) -> str:
        """What proves it."""
        return "z3" if self.name.startswith("graph.") else "CBMC"


@dataclass(frozen=True)
class Verdict:
    """What CBMC or z3 says of a proof.

    Attributes:
        failed: properties that do not hold: line and property.
        seconds: it took.
    """

    proof: Proof
    failed: tuple[str, ...]
    seconds: float

    def facts(self) -> dict[str, Any]:
        """The verdict as JSON has it."""
        proof = self.proof
        return {
            "rule": proof.rule,
            "proof": proof.name,
            "tool": proof.tool,
            "claim": proof.claim,
            "holds": not self.failed,
            "seconds": round(self.seconds, 1),
            "assumes": list(proof.assumes),
            "failed": list(self.failed),
        }

    def text(self) -> str:
        """The verdict in lines: rule, proof, tool, verdict, seconds; claim, assumptions, and what fails."""
        proof = self.proof
        rule = "" if proof.rule is None else f"rule {proof.rule}"
        verdict = "FAILS" if self.failed else "holds"
        lines = [f"{rule:9}{proof.name:24}{proof.tool:5}{verdict}  {self.seconds:6.1f} s  {proof.claim}"]
        if proof.assumes:
            lines.append(f"{'':9}assumes: {'; '.join(proof.assumes)}")
        return "\n".join([*lines, *(f"{'':9}fails: {failed}" for failed in self.failed)])


BOUNDED = ("bounds of the estimator's state that are far wider than in trials", SHIPPED, ROOT)
AIM = (*MEMORY, "--nan-check", "--float-overflow-check", "--float-div-by-zero-check")
LISTEN = (*MEMORY, "--conversion-check")


def _rule(rule: int, name: str, claim: str, *assumes: str) -> Proof:
    """A proof by induction of a rule, on the whole tick of the controller."""
    common = (SHIPPED, AIMING, STATE, AIMED, YOUNG, MISSION)
    return Proof(f"rule_{rule}.{name}", claim, rule, loops=17, checks=RULE, assumes=(*common, *assumes))


PROOFS = (
    # the parsers
    Proof("scanner.count", "counters stop at their greatest value"),
    Proof("scanner.abandon", "no access beyond the buffer"),
    Proof("scanner.take", "no access beyond the buffer; what is taken lies in it"),
    Proof("scanner.top_up", "no access beyond the buffer; as many bytes are taken as are missing"),
    Proof("scanner.search", "no access beyond the input; a frame found lies in it", loops=11),
    Proof("ubx.length", "a frame fits the buffer"),
    Proof("ubx.intact", "no access beyond a frame", loops=26),
    Proof("ubx.good", "what the receiver says of a fix is kept, and from NAV-SOL alone", assumes=(SCANNER,)),
    Proof("ubx.receive", "a fix is good, new, and in range", assumes=(SCANNER,)),
    Proof("mt.length", "a frame has 55 bytes"),
    Proof("mt.intact", "no access beyond a frame", loops=56),
    Proof("mt.sample", "a sample is new if its counter moved; it is taken whole, lost ones are counted"),
    Proof("mt.receive", "no access beyond a frame", loops=4, assumes=(SCANNER, "two frames in an input")),
    Proof("mt.value", "values are finite"),
    Proof("link.length", "a frame is no longer than a mission's"),
    Proof("link.intact", "no access beyond a frame", loops=212),
    Proof("link.abort", "an ABORT that is found lies in the bytes held", loops=10, long=True),
    Proof("link.message", "a message changes what it is for and nothing else; an ABORT is taken", loops=26),
    Proof("link.telemetry", "no access beyond a frame; it is signed, and its counter grows", loops=90),
    Proof(
        "link.accept",
        "a frame is accepted only if its tag is right, its counter grew, and it answers a recent telemetry",
        rule=11,
        loops=9,
        assumes=(TAG,),
    ),
    # the onboard program
    Proof(
        "onboard.conversions", "numbers of telemetry saturate", checks=BOTH, assumes=("the value is not NaN",)
    ),
    Proof("onboard.nearest", "numbers of telemetry are rounded to the nearest", checks=BOTH),
    Proof(
        "onboard.position", "positions of telemetry are on earth, and the place that is meant", checks=BOTH
    ),
    Proof(
        "onboard.begin",
        "a trial begins only by a START for the mission held, when all that it needs is there",
        rule=8,
        loops=19,
    ),
    # the blocks
    Proof(
        "watchdog.step",
        "ages count and stop; silence is found on its tick",
        checks=BOTH,
        short=True,
        assumes=(SHIPPED,),
    ),
    Proof(
        "command_module.step",
        "each command has its cue, and no other",
        checks=BOTH,
        short=True,
        assumes=(SHIPPED,),
    ),
    Proof(
        "local_plane.project",
        "a position anywhere on earth has a place on the plane",
        checks=BOTH,
        assumes=("the scales of the plane are those of the earth",),
    ),
    Proof(
        "four_state.judge",
        "a fix is accepted only with all its values in range",
        loops=11,
        checks=BOTH,
        short=True,
        assumes=BOUNDED,
    ),
    Proof(
        "four_state.output",
        "valid only with a recent fix, stated deviations within their limits, a heading that courses do not "
        "contradict and a live sensor; outputs are finite",
        rule=5,
        loops=11,
        checks=BOTH,
        assumes=BOUNDED,
    ),
    Proof(
        "four_state.silent",
        "no sample is taken of a sensor that repeats itself for longer than `frozen_samples`",
        rule=6,
        loops=11,
        checks=MEMORY,
        assumes=BOUNDED,
    ),
    Proof(
        "four_state.confront",
        "courses farther off than `heading_limit` count towards `heading_time`, the others against it",
        rule=6,
        loops=11,
        checks=BOTH,
        assumes=BOUNDED,
    ),
    Proof(
        "four_state.tune",
        "sigma is within [0.01, 200] m/s2",
        loops=11,
        checks=BOTH,
        long=True,
        assumes=BOUNDED,
    ),
    Proof(
        "four_state.listen", "a bad sample is not taken", loops=11, checks=LISTEN, long=True, assumes=BOUNDED
    ),
    # the controller
    Proof(
        "cmec.precedence",
        "a lost link, the operator, bad input, an invalid estimate, the table",
        loops=17,
        checks=BOTH,
        short=True,
        assumes=(YOUNG, MISSION),
    ),
    Proof(
        "cmec.step",
        "no access outside memory in a tick; counts stay in range; the order of precedence",
        loops=17,
        short=True,
        assumes=(YOUNG, MISSION, ROOT),
    ),
    Proof(
        "cmec.aim",
        "distance is within [0, 1e6] m, deviation within [-3.2, 3.2] rad",
        loops=17,
        checks=AIM,
        long=True,
        assumes=(MISSION, ROOT),
    ),
    # the safety rules
    Proof(
        "controller.start",
        "the program starts in a state that the rules' proofs assume",
        loops=17,
        checks=RULE,
    ),
    Proof(
        "controller.tick",
        "a tick leaves such a state, with the limits and without them",
        loops=17,
        checks=RULE,
        assumes=(SHIPPED, AIMING, AIMED, YOUNG, MISSION),
    ),
    _rule(
        1,
        "precedence",
        "a lost link, the operator, bad input, an invalid estimate: in this order, for STOP or silence",
    ),
    _rule(1, "mode", "else the mode's command is told, or the silence or STOP that the limits make of it"),
    _rule(2, "start", "the inductions of rule 2 begin where the program does"),
    _rule(2, "switch", "LEFT and RIGHT never follow each other directly, unless the operator commands it"),
    _rule(
        2,
        "rest",
        "they begin at rest behind a STOP of `stop_hold`, or behind `dead_time`; they last `turn_timeout`",
    ),
    _rule(2, "turns", "no more turns than MAXTURN, for any MAXTURN, with the limits and without them"),
    _rule(2, "failed", "after a failure the controller tells RECALL, STOP or nothing until a new trial"),
    _rule(2, "end", "a start that is withdrawn ends in IDLE or STOPPED"),
    _rule(3, "start", "the inductions of rule 3 begin where the program does"),
    _rule(
        3,
        "budget",
        "issues, vibration, FORWARD and RECALL stay within those of leg and mission, to the tick",
        EXACT,
    ),
    _rule(3, "window", "and within those of any interval of the window's length, to the tick", EXACT),
    _rule(3, "refused", "a refused cue gives STOP, then silence until a new trial, or an operator's STOP"),
    _rule(3, "longest", "no command sounds longer than `longest_*`"),
    _rule(4, "start", "the inductions of rule 4 begin where the program does"),
    _rule(4, "breach", "a broken limit ends in STOPPED with STOP; only a start, or the recall, leads again"),
    _rule(4, "times", "mission, leg and recall last no longer than they may, by less than 0.2 s", NO_RECALL),
    _rule(4, "still", "an animal that stays where it is is not led on beyond `progress_time`", NO_RECALL),
    _rule(4, "departing", "an animal that comes too far from its target is stopped at the survey"),
    _rule(4, "survey", "a trial is surveyed every 0.2 s"),
    _rule(
        7, "radius", "an animal beyond `fence_radius` by 1 m, along north or east, is stopped within 0.2 s"
    ),
    _rule(9, "start", "the program starts with nobody led"),
    _rule(9, "link", "a lost link ends a trial in STOPPED with STOP", "`resume` is off, as shipped"),
    _rule(9, "begin", "only a start in IDLE begins a trial, with the limits and without them; or the recall"),
    _rule(12, "start", "the program starts with nobody led"),
    _rule(12, "silence", "nobody leads: in each mode STOP for `stop_hold`, then silence"),
)
REAL = "real numbers in place of floats; inputs are numbers"
TIMES = f"any parameters; {', '.join(graph.TIMES)} of two ticks at least"
STRAIGHT = "times, counts and angles are free; the animal is south of its target"


def _graph(rule: int | None, name: str, claim: str, *assumes: str) -> Proof:
    """A proof on the controller's graph."""
    return Proof(f"graph.{name}", claim, rule, assumes=(REAL, *assumes))


GRAPH = (
    _graph(None, "state", "a tick leaves a state that the proofs on the graph assume", TIMES, MISSION),
    _graph(2, "switch", "LEFT and RIGHT never follow each other directly, for any times", TIMES, MISSION),
    _graph(
        2,
        "rest",
        "they begin at rest behind a held STOP, or behind `dead_time`; they last `turn_timeout`: any times",
        TIMES,
        MISSION,
    ),
    _graph(4, "ends", "a trial ends within `mission_time`, for any times", TIMES, MISSION, NO_RECALL),
    _graph(
        None,
        "livelock",
        "FORWARD behind a stop is not stopped on the next tick, unless the animal turned or moved",
        TIMES,
        MISSION,
        "`limit_stop_deviation` is on, as shipped",
    ),
    _graph(None, "modes", "each mode is reached from the start; the model repeats the runs", STRAIGHT),
    _graph(None, "rows", "no row of the table is shadowed by those before it; the model takes each", TIMES),
)
ALL = (*PROOFS, *GRAPH)
NAMED = {proof.name: proof for proof in ALL}


def find(chosen: Sequence[str] = ()) -> list[Proof]:
    """The proofs of rules, by number, and those by name or unit; all if none is chosen.

    Raises:
        UsageError: there is no such rule or name.
    """
    proofs: list[Proof] = []
    for word in chosen:
        matching = [p for p in ALL if word in (p.name, p.name.split(".")[0], str(p.rule))]
        if not matching:
            rules = ", ".join(sorted({str(p.rule) for p in ALL if p.rule is not None}, key=int))
            units = ", ".join(dict.fromkeys(p.name.split(".")[0] for p in ALL))
            raise UsageError(f"{word}: no such proof; rules that are proved: {rules}; units: {units}")
        proofs += [p for p in matching if p not in proofs]
    return proofs or list(ALL)


def write_sources(folder: Path) -> None:
    """Write the C that ships and the proofs into a folder."""
    write_files(library(), folder)
    shutil.copytree(SOURCES, folder, dirs_exist_ok=True)


def prove(proof: Proof, folder: Path, more: Sequence[str] = (), timeout: float = TIMEOUT) -> Verdict:
    """Ask CBMC for a proof, in a folder with the sources; z3 for one on the graph.

    Args:
        more: further options of CBMC.

    Raises:
        CbmcError: no answer in time (s), or CBMC refuses the C.
        ToolchainError: there is no CBMC.
        GraphError: z3 has no answer.
        SolverError: there is no z3.
    """
    unit, function = proof.name.split(".")
    begun = time.monotonic()
    if unit == "graph":
        return Verdict(proof, graph.prove(function), time.monotonic() - begun)
    answer = cbmc.check(
        [f"prove_{unit}.c"],
        f"prove_{function}",
        folder,
        unwind=proof.loops,
        checks=(*proof.checks, *more),
        timeout=timeout,
    )
    if answer.checks == 0:
        raise cbmc.CbmcError(f"{proof.name}: CBMC had nothing to check")
    return Verdict(proof, answer.failed, time.monotonic() - begun)

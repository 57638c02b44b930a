"""Proofs on the controller's graph by z3, for what CBMC cannot: any times, what can be reached, no livelock.

They are about the model: real numbers in place of floats, and parameters of which the firmware has one set.
What z3 finds against a claim is tried in the model in Python, and told with what the model says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

import casadi as ca

from codegen.blocks.formulas import Formulas, Instead, Tick, Value, Values
from models.cmec import Cmec
from models.commands import Command
from models.errors import CanineError
from models.kit.block import Block
from models.kit.model import Model
from models.kit.timing import TICK, TOLERANCE
from models.kit.tracing import Table, Update
from models.modes import LEADING, Anomaly, Mode
from models.safety import SURVEY

TIMES = (
    "stop_hold",
    "turn_timeout",
    "dead_time",
    "longest_vibration",
    "longest_stop",
)  # of two ticks at least
FAR = 1e5  # m: of a mission's places from the origin
# updates that may have any results in proofs
AIMS = ("aim", "learn_drift", "learn_response", "aim_off", "lead_turn", "brake")
HALF_TURN = Fraction(3141592653589793, 10**15)  # rad
DEPTH = 4  # ticks from the start to the modes that are farthest from it; before the first survey
SHOWN = ("now", "command", "mode", "anomaly")
TIMEOUT = 120.0  # s, for a question
GOING = range(Mode.FORWARD, Mode.STOP_AT_WAYPOINT + 1)
TURNS = {Mode.LEFT: Command.LEFT, Mode.RIGHT: Command.RIGHT}
HALTING = (Mode.STOP_TO_TURN, Mode.STOP_AT_WAYPOINT)


class GraphError(CanineError):
    """z3 gives no answer."""


@dataclass(frozen=True)
class Step:
    """A tick from any state, with any inputs and parameters.

    Attributes:
        before, after: values by flat name.
        rows: of each row of the table, whether it is taken.
        facts: what is known of them.
    """

    f: Formulas
    before: Values
    after: Values
    rows: tuple[Value, ...]
    facts: tuple[Value, ...]


def is_one_of(f: Formulas, value: Value, members: Any) -> Value:
    """Is a value among these numbers?"""
    return f.z3.Or(*(value == int(member) for member in members))


def any_aim(f: Formulas) -> Instead:
    """Any distance and deviation, and any results of what aims off, in place of those computed."""
    return {update: partial(_given, _aimed(f, names)) for update, names in _results_of_aims(f).items()}


def _results_of_aims(f: Formulas) -> dict[str, tuple[str, ...]]:
    """What each update of AIMS assigns, in its order."""
    writes = {each.name: each.writes for each in f.block.program().tick if isinstance(each, Update)}
    return {name: writes[name] for name in AIMS}


def _given(values: Values, _: Values) -> Values:
    return values


def _aimed(f: Formulas, names: Sequence[str]) -> Values:
    return {name: f.fresh(f"{name} aimed", f.variables[name]) for name in names}


def possible(f: Formulas, v: Values) -> Value:
    """A state that can arise; `prove_state` shows that it is kept."""
    z3 = f.z3
    places = ("target", "base", *(f"route[{i}]" for i in range(1, 17)))
    flags = ("fresh", "turned", "over", "surveyed", "recalling")
    names = [
        place.replace("[", f"_{axis}[") if "[" in place else f"{place}_{axis}"
        for place in places
        for axis in ("north", "east")
    ]
    return z3.And(
        *f.declared(v, "state"),
        *(z3.And(v[name] >= -FAR, v[name] <= FAR) for name in names),
        z3.And(v["now"] >= 0, v["now"] <= int(max(Mode))),
        z3.Or(v["overruled"] == 0, z3.And(v["overruled"] >= 6, v["overruled"] <= int(Anomaly.BAD_INPUT))),
        z3.And(v["planned"] >= 0, v["planned"] <= int(max(Command))),
        z3.And(v["cue"] >= 0, v["cue"] <= int(max(Command))),
        z3.And(v["breach"] >= 0, v["breach"] <= int(max(Anomaly))),
        z3.Implies(is_one_of(f, v["now"], GOING), v["reached"] < v["count"]),
        v["reached"] <= v["count"],
        v["survey_ticks"] <= SURVEY - 1,
        z3.Not(v["beside"]),
        z3.Or(v["edge"] == 0, z3.And(v["edge"] >= 1, v["edge"] <= v["corners"] - 1)),
        z3.Or(
            v["mode"] == v["now"],
            z3.And(v["mode"] == int(Mode.STOPPED), v["now"] == int(Mode.FAILURE_RECALL)),
        ),
        v["led"] == z3.And(v["guarded"], is_one_of(f, v["mode"], LEADING)),
        z3.Implies(z3.Not(v["guarded"]), z3.And(v["breach"] == 0, *(z3.Not(v[flag]) for flag in flags))),
    )


def any_step(block: type[Block]) -> Step:
    """A tick from any state that can arise."""
    f = Formulas(block)
    before = f.free("", "state", "input", "parameter", "output")
    tick = f.tick(before, any_aim(f))
    aim = _aimed(f, [name for names in _results_of_aims(f).values() for name in names])
    deviation, distance = aim["deviation"], aim["distance"]
    aimed = f.z3.And(
        *(limit for name, value in aim.items() for limit in f.limits(value, f.variables[name])),
        *(deviation > -HALF_TURN, deviation <= HALF_TURN, distance >= 0, distance <= 1e6),
    )
    lasting = [before[name] >= 2 * Fraction(repr(TICK)) for name in TIMES]
    known = (possible(f, before), aimed, *f.declared(before, "parameter"), *lasting, *tick.facts)
    return Step(f, before, tick.values, tuple(tick.rows), known)


def lasted(f: Formulas, ticks: Value, time: Value, block: type[Block]) -> Value:
    """Have the ticks lasted the time? As models/kit/timing.py has it."""
    tick = Fraction(repr(block.sample_time))
    return f.z3.ToReal(ticks) * tick > time - Fraction(repr(TOLERANCE)) * tick


def agrees(f: Formulas, v: Values) -> Value:
    """With the limits on, the cue is the mode's, and the command is the cue or silence."""
    z3 = f.z3
    turns = [z3.Implies(v["now"] == int(mode), v["cue"] == int(command)) for mode, command in TURNS.items()]
    longest = lasted(f, v["cue_ticks"], v["longest_vibration"], Cmec)
    return z3.And(
        v["guarded"],
        z3.Implies(is_one_of(f, v["now"], GOING), z3.Not(v["exhausted"])),
        *turns,
        z3.Implies(v["now"] == int(Mode.DEAD), v["cue"] == int(Command.NONE)),
        z3.Implies(is_one_of(f, v["now"], HALTING), z3.Or(v["cue"] == int(Command.STOP), v["ticks"] == 0)),
        z3.Or(
            v["command"] == v["cue"],
            z3.And(v["command"] == 0, z3.Or(z3.Not(is_one_of(f, v["cue"], TURNS.values())), longest)),
        ),
    )


def overridden(f: Formulas, v: Values) -> Value:
    """Does the operator's command hold on this tick?"""
    return f.z3.And(v["link_ok"], v["override"] > 0, v["override"] <= int(max(Command)))


Claim = tuple[list[Value], Value]  # what is assumed, and what must follow


def prove_state(s: Step) -> Claim:
    """What the other proofs assume of a state is kept."""
    return [], possible(s.f, s.after)


def prove_switch(s: Step) -> Claim:
    """LEFT and RIGHT do not follow each other directly."""
    z3, f, before, after = s.f.z3, s.f, s.before["command"], s.after["command"]
    turned = z3.And(
        is_one_of(f, before, TURNS.values()), is_one_of(f, after, TURNS.values()), before != after
    )
    return [agrees(f, s.before)], z3.And(agrees(f, s.after), z3.Or(z3.Not(turned), overridden(f, s.after)))


def prove_rest(s: Step) -> Claim:
    """A direction begins at rest behind a held STOP, or behind a no-command period; it ends in time.

    The ticks are counted by what is told, not by the controller: of STOP, of silence, of a turn.
    """
    z3, f, b, a = s.f.z3, s.f, s.before, s.after
    stop, silence, turn = z3.Ints("stop silence turn")
    directs = z3.And(is_one_of(f, a["command"], TURNS.values()), z3.Not(overridden(f, a)))
    same = a["command"] == b["command"]
    ticks = (
        z3.If(a["cue"] == int(Command.STOP), stop + 1, 0),
        z3.If(a["command"] == int(Command.NONE), silence + 1, 0),
        z3.If(directs, z3.If(same, turn + 1, 1), 0),
    )

    def counts(v: Values, stop: Value, silence: Value, turn: Value) -> Value:
        return z3.And(
            z3.Implies(is_one_of(f, v["now"], HALTING), v["ticks"] <= stop),
            z3.Implies(v["now"] == int(Mode.DEAD), v["ticks"] < silence),
            z3.Implies(is_one_of(f, v["now"], TURNS), turn <= v["ticks"] + 1),
        )

    held = z3.And(
        lasted(f, stop + 1, a["stop_hold"], Cmec),
        z3.If(a["speed"] >= 0, a["speed"], -a["speed"]) < a["stopped_speed"],
        a["speed_sd"] <= a["rest_speed_sd"],
    )
    begins = z3.And(directs, z3.Not(same))
    assumed = [agrees(f, b), stop >= 0, silence >= 0, turn >= 0, counts(b, stop, silence, turn)]
    in_time = z3.Or(ticks[2] <= 1, z3.Not(lasted(f, ticks[2] - 1, a["turn_timeout"], Cmec)))
    rests = z3.Or(held, lasted(f, silence, a["dead_time"], Cmec))
    return assumed, z3.And(agrees(f, a), counts(a, *ticks), z3.Implies(begins, rests), in_time)


def prove_ends(s: Step) -> Claim:
    """A trial ends within `mission_time` and a survey, whatever the times are."""
    z3, b, a = s.f.z3, s.before, s.after
    led = z3.Int("led for")  # ticks
    survey = Fraction(repr(SURVEY * Cmec.sample_time))

    def counts(v: Values, led: Value) -> Value:
        late = z3.ToReal(v["surveys"]) * survey > v["mission_time"] - Fraction(repr(TOLERANCE)) * survey
        surveyed = led <= SURVEY * v["surveys"] + v["survey_ticks"] + 1
        return z3.If(v["led"], z3.And(surveyed, z3.Or(v["surveys"] == 0, z3.Not(late))), led == 0)

    led_now = z3.If(a["led"], led + 1, 0)
    longest = z3.ToReal(led_now) * Fraction(repr(Cmec.sample_time)) <= a["mission_time"] + survey
    leads_on = z3.Or(a["recalling"], a["mode"] != a["now"])
    no_recall = [z3.Not(b["fence_recall"]), z3.Not(b["recalling"]), b["mode"] == b["now"]]
    return [b["guarded"], *no_recall, led >= 0, counts(b, led)], z3.And(
        counts(a, led_now), longest, z3.Not(leads_on)
    )


def prove_livelock(s: Step) -> Claim:
    """A stop that ends in FORWARD does not begin again on the next tick, if the animal stays as it is."""
    z3, f = s.f.z3, s.f
    again = f.tick(s.after, any_aim(f))
    resumed = z3.And(
        is_one_of(f, s.before["now"], (*HALTING, Mode.DEAD)), s.after["now"] == int(Mode.FORWARD)
    )
    return (
        [s.before["limit_stop_deviation"], resumed, *again.facts],
        again.values["now"] != int(Mode.STOP_TO_TURN),
    )


INDUCTIONS: dict[str, Callable[[Step], Claim]] = {
    "state": prove_state,
    "switch": prove_switch,
    "rest": prove_rest,
    "ends": prove_ends,
    "livelock": prove_livelock,
}


def against(name: str, block: type[Block] = Cmec) -> tuple[str, ...]:
    """A step against a claim of INDUCTIONS, and what the model in Python makes of it; () if there is none.

    Raises:
        GraphError: z3 gives no answer.
    """
    step = any_step(block)
    assumed, follows = INDUCTIONS[name](step)
    question = solver_of(step.f)
    question.add(*step.facts, *assumed, step.f.z3.Not(follows))
    if not ask(step.f, question, name):
        return ()
    example = question.model()
    if ask(step.f, question, name, *plain(step)):  # one that the model can repeat, if there is one
        example = question.model()
    return (str(retried(block, step, example)),)


def plain(step: Step) -> list[Value]:
    """Numbers with which the model computes what z3 does, whose numbers are exact.

    All places are the origin, so that products and squares are 0. Times are no ties with whole ticks, and all
    other numbers are exact in binary.
    """
    f, v = step.f, step.before
    named = (*f.names["state"], *f.names["parameter"])
    places = [name for name in named if "_north" in name or "_east" in name]
    aim = {name: value for update in any_aim(f).values() for name, value in update({}).items()}
    aimed_before = [v[name] for name in aim if name in f.names["state"]]
    parameters = [v[name] for name in f.names["parameter"]]
    numbers = [v["closest"], *aim.values(), *aimed_before, *parameters]
    zero = [v[name] == 0 for name in (*places, "north", "east")]
    return zero + [f.z3.IsInt(8 * number) for number in numbers if f.z3.is_real(number)]


def untaken(block: type[Block]) -> tuple[str, ...]:
    """The rows of the table that no tick takes, from any state; or that the model does not take.

    Raises:
        GraphError: z3 gives no answer.
    """
    step, failed = any_step(block), []
    question = solver_of(step.f)
    question.add(*step.facts, *plain(step))
    tables = [phase for phase in block.program().tick if isinstance(phase, Table)]
    for row, taken in zip((row for table in tables for row in table.rows), step.rows, strict=True):
        text = f"{Mode(row.mode).name}: {row.when} -> {Mode(row.next).name}"
        if not ask(step.f, question, "rows", taken):
            failed.append(f"no tick takes the row {text}")
        elif not (tried := retried(block, step, question.model())).same:
            failed.append(f"the model does not take the row {text}: {tried}")
    return tuple(failed)


def solver_of(f: Formulas) -> Any:
    """A solver with a time limit."""
    question = f.z3.Solver()
    question.set("timeout", int(1000 * TIMEOUT))
    return question


def ask(f: Formulas, question: Any, name: str, *more: Value) -> bool:
    """Is there an answer to a question?

    Raises:
        GraphError: z3 does not know.
    """
    answer = question.check(*more)
    if answer == f.z3.unknown:
        raise GraphError(f"graph.{name}: z3 has no answer ({question.reason_unknown()})")
    return bool(answer == f.z3.sat)


def number_of(example: Any, value: Value) -> float:
    """The number that a value has in what z3 found."""
    number = example.eval(value, model_completion=True)
    if number.sort().name() == "Bool":
        return float(str(number) == "True")
    return float(number.as_fraction()) if number.sort().name() == "Real" else float(number.as_long())


@dataclass(frozen=True)
class Retried:
    """A step that z3 found, made in the model in Python.

    Attributes:
        same: the model does what z3 says.
    """

    text: str
    same: bool

    def __str__(self) -> str:
        model = "so in the model too" if self.same else "not so in the model: its numbers differ"
        return f"{self.text} ({model})"


def retried(block: type[Block], step: Step, example: Any) -> Retried:
    """A step made in the model, from the same state and inputs, with what was aimed at."""
    f = step.f
    aims = {
        f"{block.title()}_{update}": {name: number_of(example, value) for name, value in of({}).items()}
        for update, of in any_aim(f).items()
    }
    aimed = aims[f"{block.title()}_aim"]

    def replace(function: Any) -> Any:
        if function.name() not in aims:
            return function
        groups = [ca.SX.sym(f"v{i}", *function.size_in(i)) for i in range(function.n_in())]
        return ca.Function(function.name(), groups, [ca.SX(list(aims[function.name()].values()))])

    before = {name: number_of(example, value) for name, value in step.before.items()}
    model = Model(block, {name: before[name] for name in f.names["parameter"]}, replace)
    for name, value in before.items():
        model[name] = value
    model.step()
    same = all(model[name] == number_of(example, step.after[name]) for name in SHOWN)
    inputs = {name: before[name] for name in ("speed", "override", "link_ok", "valid", "start")}
    values = ", ".join(f"{name} {value:g}" for name, value in (aimed | inputs).items())
    return Retried(
        f"{Mode(int(before['now'])).name} for {before['ticks']:g} ticks, {values}: then "
        f"{Mode(int(model['now'])).name}, command {Command(int(model['command'])).name}",
        same,
    )


# What can be reached


@dataclass(frozen=True)
class Run:
    """A run from the start, tick by tick.

    Attributes:
        parameters: values by flat name.
        inputs: of each tick.
        ticks: as formulas.
    """

    f: Formulas
    parameters: Values
    inputs: tuple[Values, ...]
    ticks: tuple[Tick, ...]
    facts: tuple[Value, ...]


FREE = (
    "stop_hold", "turn_timeout", "forward_timeout", "dead_time", "max_turns", "moving_deviation",
    "stop_deviation", "turn_end_deviation", "waypoint_count", "home_north", "waypoint_north[1]",
    "waypoint_north[2]",
)  # fmt: skip
MOVED = ("speed", "heading", "north", "start", "override", "valid", "link_ok")


def runs(block: type[Block], depth: int = DEPTH) -> Run:
    """All runs of so many ticks of an animal south of its target, on one meridian: the angle to it is 0.

    Numbers are multiples of 1/8, so that the model computes the same comparisons.
    """
    f = Formulas(block)
    z3 = f.z3
    parameters = {
        name: f.fresh(name, f.variables[name]) if name in FREE else f.number(value, f.variables[name])
        for variable in block.group("parameter")
        for name, value in zip(variable.flat_names, variable.start, strict=True)
    }
    parameters["guarded"] = z3.BoolVal(True)
    facts = f.declared(parameters, "parameter")
    facts += [fine(z3, parameters[name]) for name in FREE if z3.is_real(parameters[name])]
    values, ticks, inputs = f.starts() | parameters, [], []
    for k in range(depth):
        inputs.append(
            {
                name: f.fresh(f"{name} {k}", f.variables[name])
                if name in MOVED
                else f.number(0.0, f.variables[name])
                for name in f.names["input"]
            }
        )
        facts += f.declared(inputs[-1], "input")
        facts += [fine(z3, inputs[-1][name]) for name in ("speed", "heading", "north")]
        facts += [inputs[-1]["heading"] > -3, inputs[-1]["heading"] < 3]
        ticks.append(f.tick(values | inputs[-1], {"aim": straight}))
        values = ticks[-1].values
        facts += [*ticks[-1].facts, values["target_north"] >= inputs[-1]["north"]]
    return Run(f, parameters, tuple(inputs), tuple(ticks), tuple(facts))


def straight(v: Values) -> Values:
    """The distance and deviation of an animal south of its target."""
    return {"distance": v["target_north"] - v["north"], "deviation": -v["heading"]}


def fine(z3: Any, value: Value) -> Value:
    """A multiple of 1/8: exact in binary, and as a time no tie with whole ticks."""
    return z3.IsInt(8 * value)


def unreached(block: type[Block]) -> tuple[str, ...]:
    """The modes that no run from the start comes to, or none that the model repeats.

    Raises:
        GraphError: z3 gives no answer.
    """
    run, failed = runs(block), []
    question = solver_of(run.f)
    question.add(*run.facts)
    left = set(Mode)
    for mode in Mode:
        if mode not in left:
            continue
        if not ask(
            run.f, question, "modes", run.f.z3.Or(*(tick.values["now"] == int(mode) for tick in run.ticks))
        ):
            failed.append(f"{mode.name} is not reached within {len(run.ticks)} ticks from the start")
            continue
        example = question.model()
        if not repeats(block, run, example):
            failed.append(f"{mode.name}: the model does not repeat the run that z3 found")
        left -= {Mode(int(number_of(example, tick.values["now"]))) for tick in run.ticks}
    return tuple(failed)


def repeats(block: type[Block], run: Run, example: Any) -> bool:
    """Does the model go through the same modes, anomalies and counts as the run?"""
    model = Model(block, {name: number_of(example, value) for name, value in run.parameters.items()})
    model.initialize()
    for inputs, tick in zip(run.inputs, run.ticks, strict=True):
        for name, value in inputs.items():
            model[name] = number_of(example, value)
        model.step()
        compared = ("now", "command", "anomaly", "directional_commands", "planned", "ticks")
        if any(model[name] != number_of(example, tick.values[name]) for name in compared):
            return False
    return True


def prove(name: str, block: type[Block] = Cmec) -> tuple[str, ...]:
    """What speaks against a claim; () if it holds.

    Raises:
        GraphError: z3 gives no answer.
        SolverError: there is no z3.
    """
    if name in INDUCTIONS:
        return against(name, block)
    return {"modes": unreached, "rows": untaken}[name](block)

"""Proofs on the controller's graph by z3; and faults planted in the model, which they must find."""

from __future__ import annotations

import builtins
import importlib.util
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from codegen.blocks.formulas import Formulas, SolverError, solver
from codegen.firmware import graph
from codegen.firmware.proving import GRAPH
from harness.main import FAULT
from models import cmec, fence, safety
from models.cmec import Cmec
from models.errors import CanineError
from models.kit.block import Block
from models.kit.model import Model
from models.modes import Mode
from tests.codegen.firmware.test_c_quality import leave_out
from tests.harness.command import canine

NAMES = [proof.name.removeprefix("graph.") for proof in GRAPH]
# what becomes of a text of the model, and what the claim's counterexample or gap says
REPEATED = "so in the model too"
SWITCH = 'Mode.DEAD,\n                {"ticks": 0, "planned": opposite'
FAULTS = (
    ("state", cmec, "m.turns = where(m.reset_turns, 0, m.turns)", "m.turns = m.turns - 1", REPEATED),
    ("switch", cmec, SWITCH, SWITCH.replace("Mode.DEAD", "Mode(opposite - 1)"), REPEATED),
    ("rest", cmec, "ca.fabs(m.speed) < m.stopped_speed", "m.speed < m.stopped_speed", REPEATED),
    ("rest", cmec, "m.speed_sd <= m.rest_speed_sd", "1", REPEATED),
    ("rest", cmec, "            m._lasted(m.stop_hold),\n            ca", "            ca", REPEATED),
    ("rest", cmec, "m._lasted(m.turn_timeout)", "m._lasted(m.turn_timeout + m.dead_time)", REPEATED),
    ("rest", cmec, "over = Condition(m._lasted(m.dead_time)", "over = Condition(m.ticks > 9", REPEATED),
    ("ends", safety, "lasted(m.surveys, m.mission_time, SURVEY * m.sample_time)", "0", REPEATED),
    ("ends", safety, "m.surveys = _counted(m.leg_ticks, SURVEY), _counted(m.surveys)",
     "m.surveys = _counted(m.leg_ticks, SURVEY), m.surveys", REPEATED),
    ("livelock", cmec, "off >= m.moving_deviation", "off >= 0.5 * m.moving_deviation", REPEATED),
    ("livelock", cmec, "any_of(m.offset == 0, roughly_aligned.holds)", "1", REPEATED),
    ("modes", cmec, "Mode.STOP_AT_WAYPOINT, at_rest & reached, Mode.RECALL",
     "Mode.STOP_AT_WAYPOINT, at_rest & reached & aligned, Mode.FORWARD",
     "RECALL is not reached.*; SUCCESS is not reached"),
    ("rows", cmec, "go_on = Condition(m.planned == Command.FORWARD", "go_on = Condition(m.planned >= 0",
     "no tick takes the row DEAD: .*LEFT is planned -> LEFT"),
)  # fmt: skip


@pytest.fixture(scope="module")
def z3() -> Any:
    """z3 is there."""
    try:
        return solver()
    except SolverError as reason:
        leave_out(str(reason))


@contextmanager
def planted(module: Any, old: str, new: str) -> Iterator[type[Block]]:
    """The controller's class of a model with one text changed."""
    source = Path(module.__file__).read_text()
    assert old in source, f"{module.__name__} has no {old!r}: mend the fault"
    chain = (safety, fence, cmec)  # each imports the one before
    names = [each.__name__ for each in chain[chain.index(module) :]]
    before = {name: sys.modules[name] for name in names}
    try:
        for name in names:
            specification = importlib.util.find_spec(name)
            assert specification is not None
            made = importlib.util.module_from_spec(specification)
            text = Path(str(specification.origin)).read_text()
            sys.modules[name] = made
            exec(
                compile(text.replace(old, new) if name == module.__name__ else text, f"<{name}>", "exec"),
                made.__dict__,
            )
        yield sys.modules[cmec.__name__].Cmec
    finally:
        sys.modules.update(before)


@pytest.mark.usefixtures("z3")
@pytest.mark.parametrize("name", NAMES)
def test_z3_proves_it(name: str) -> None:
    assert graph.prove(name) == ()


@pytest.mark.usefixtures("z3")
@pytest.mark.parametrize(
    ("name", "module", "old", "new", "says"), FAULTS, ids=[f"{fault[0]}-{fault[2][:30]}" for fault in FAULTS]
)
def test_the_proof_fails_with_the_planted_fault(
    name: str, module: Any, old: str, new: str, says: str
) -> None:
    with planted(module, old, new) as faulty:
        failed = graph.prove(name, faulty)
    assert failed
    assert re.search(says, "; ".join(failed))
    # and the model does what is told against it
    assert not any("not so in the model" in text for text in failed)


@pytest.mark.usefixtures("z3")
def test_the_literal_readings_livelock_is_found_and_repeated_in_the_model() -> None:
    """With h' < h'' the literal reading stops, does not turn, goes on for a tick, and stops."""
    with planted(
        cmec, "all_of(m.limit_stop_deviation, m.moving_deviation < m.stop_deviation)", "0"
    ) as literal:
        (text,) = graph.prove("livelock", literal)
    assert re.match(r"(STOP_TO_TURN|STOP_AT_WAYPOINT|DEAD) for", text)
    assert re.search("then FORWARD, .*so in the model too", text)


@pytest.mark.usefixtures("z3")
def test_a_tick_of_formulas_is_a_tick_of_the_model(z3: Any) -> None:
    # given numbers for all that a tick reads, where products are of constants
    f, model = Formulas(Cmec), Model(Cmec, {"waypoint_north[1]": 50.0, "guarded": 1.0})
    model.initialize()
    model["start"], model["heading"], model["speed"] = 1.0, 0.25, 1.0
    for _ in range(45):
        values = {
            name: f.number(model[name], f.variables[name])
            for kind in ("state", "input", "parameter", "output")
            for name in f.names[kind]
        }
        model.step()
        aimed = {name: f.number(model[name], f.variables[name]) for name in ("distance", "deviation")}
        tick = f.tick(values, {"aim": partial(_given, aimed)})
        # then all of its states, and its outputs, are those of the model
        different = [
            name
            for kind in ("state", "output")
            for name in f.names[kind]
            if abs(float(_number(z3.simplify(tick.values[name]))) - model[name]) > 1e-12
        ]
        assert different == []
        model["heading"] += 0.04
    assert model["mode"] == Mode.STOP_TO_TURN


def _given(aimed: dict[str, Any], _: Any) -> dict[str, Any]:
    return aimed


def _number(value: Any) -> float:
    text = str(value)
    return (
        float(text == "True")
        if text in ("True", "False")
        else float(value.as_fraction() if "/" in text else text)
    )


def test_without_z3_the_proof_says_what_to_install(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    imported = builtins.__import__

    def refuse(name: str, *rest: Any, **more: Any) -> Any:
        if name == "z3":
            raise ImportError(name)
        return imported(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", refuse)
    status, _, error = canine(capsys, "prove", "graph.state")
    assert status == FAULT
    assert 'pip install "guided-canine[z3]"' in error


def test_a_question_that_z3_does_not_answer_is_an_error_with_its_name(
    z3: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graph, "TIMEOUT", 0.001)
    with pytest.raises(CanineError, match=r"^graph\.modes: z3 has no answer"):
        graph.prove("modes")

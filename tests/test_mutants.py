"""`make mutants`: what it changes, and how it tells survivors from the killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.mutants import __main__ as program
from tests.mutants import c, python
from tests.mutants.mutant import Mutant
from tests.mutants.targets import PROJECT, TARGETS, Target
from tests.mutants.trial import FAILED, OK, OVER, Copy


def changes(mutants: list[Mutant]) -> set[str]:
    return {mutant.becomes for mutant in mutants}


def test_comparisons_logic_numbers_and_statements_of_c_are_changed() -> None:
    source = (
        "bool f(int a)\n{\n    if ((a < 3) && !on(a)) {\n        s->n = 7U;\n    }\n    return true;\n}\n"
    )
    assert changes(c.mutants("f.c", source)) == {
        "if ((a <= 3) && !on(a)) {",
        "if ((a >= 3) && !on(a)) {",
        "if ((a < 4) && !on(a)) {",
        "if ((a < 2) && !on(a)) {",
        "if ((a < 3) || !on(a)) {",
        "if ((a < 3) && on(a)) {",
        "if (true && !on(a)) {",
        "if ((a < 3) && true) {",
        "if (!((a < 3) && !on(a))) {",
        "s->n = 8U;",
        "s->n = 6U;",
        ";",
        "return false;",
    }


def test_comments_types_and_declarations_of_c_are_left_alone() -> None:
    source = '#include "a.h"\n/* a < b && 3 */\nstatic uint8_t *f(const uint8_t *a);\nchar *text = "1 < 2";\n'
    assert c.mutants("f.c", source) == []


def test_the_logic_of_models_is_changed_and_declarations_are_left_alone() -> None:
    source = (
        "class A(Block):\n    x = State('m', 'place', start=3)\n\n    def f(m) -> None:\n"
        "        m.x = where(all_of(m.x < 1, m.y), Mode.LEFT, m.z)\n"
    )
    assert changes(python.mutants("a.py", source)) == {
        "pass",
        "m.x = where(all_of(m.x <= 1, m.y), Mode.LEFT, m.z)",
        "m.x = where(all_of(m.x >= 1, m.y), Mode.LEFT, m.z)",
        "m.x = where(all_of(m.x < 2, m.y), Mode.LEFT, m.z)",
        "m.x = where(all_of(m.x < 0, m.y), Mode.LEFT, m.z)",
        "m.x = where(any_of(m.x < 1, m.y), Mode.LEFT, m.z)",
        "m.x = where(all_of(m.x < 1), Mode.LEFT, m.z)",
        "m.x = where(all_of(m.y), Mode.LEFT, m.z)",
        "m.x = where(all_of(m.x < 1, m.y), Mode.RIGHT, m.z)",
        "m.x = ca.SX(Mode.LEFT)",
        "m.x = ca.SX(m.z)",
    }


def test_every_target_has_mutants_and_each_differs_from_its_source() -> None:
    for target in TARGETS:
        source = (PROJECT / target.file).read_text()
        assert len(target.mutants()) > 10
        assert all(mutant.text != source for mutant in target.mutants())
        for test in target.tests:
            assert not test.endswith(".py") or (PROJECT / test).is_file(), test


def test_what_is_accepted_has_a_reason_and_is_of_a_target() -> None:
    files = {target.file for target in TARGETS}
    for (file, _, _), reason in program.accepted().items():
        assert file in files
        assert len(reason.split()) >= 3


def test_survivors_without_a_reason_and_reasons_without_a_survivor_are_wrong() -> None:
    target = next(target for target in TARGETS if target.file.endswith("watchdog.py"))
    first, second, third = target.mutants()[:3]
    outcome = program.Outcome(survivors=[first, second])
    reasons = {second.key: "it is so", third.key: "it was so", (first.file, "old", "gone"): "it was so"}
    survives, killed, gone = program.verdict(outcome, {m.key for m in (first, second, third)}, reasons)
    assert survives == f"survives: {first}"
    assert "what a test kills now" in killed
    assert third.becomes in killed
    assert "no mutant any more" in gone
    # and one that did not end in time says nothing: the machine may have been busy
    late = program.Outcome(survivors=[second], over=[third])
    assert program.verdict(late, {second.key, third.key}, {second.key: "so", third.key: "so"}) == []


def test_a_filter_without_a_mutant_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main(["nothing.c"]) == 2
    assert "files: cmec.py, safety.py" in capsys.readouterr().err


def finish(copy: Copy) -> int:
    while (result := copy.result()) is None:
        time.sleep(0.01)
    return result[0]


def test_a_trial_tells_killed_mutants_from_those_that_survive_or_do_not_end(
    tmp_path: Path,
) -> None:
    # given a test of fuzzy.py in a copy, which no process of this one shares
    target = Target("models/fuzzy.py", ("tests/models/test_fuzzy.py", "-k", "choice_6"))
    source = (PROJECT / target.file).read_text()
    script = f"""
from collections import Counter
from pathlib import Path
from tests.mutants.targets import Target
from tests.mutants.trial import Copy
from tests.test_mutants import finish
copy = Copy(Path({str(tmp_path)!r}))
source = Path({str(PROJECT / target.file)!r}).read_text()
for text, limit in ((source, 60), (source.replace("RAMP = 5", "RAMP = 4"), 60), (source, 0.0)):
    copy.begin({target.file!r}, text, {target.tests!r}, limit, Counter())
    print(finish(copy))
    assert (copy.root / {target.file!r}).read_text() == source
"""
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=PROJECT, capture_output=True, text=True, check=False
    )
    # then it passes as it is, fails with the mutant, and is stopped when its time is over
    assert done.stdout.split() == [str(OK), str(FAILED), str(OVER)], done.stderr
    assert (PROJECT / target.file).read_text() == source


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_interrupted_leaves_nothing_behind(number: signal.Signals, tmp_path: Path) -> None:
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    run = subprocess.Popen(
        [sys.executable, "-m", "tests.mutants", "fuzzy.py", "--jobs", "1"],
        cwd=PROJECT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        until = time.monotonic() + 60
        while not list(tmp_path.glob("*/0/project/tests")) and time.monotonic() < until:
            time.sleep(0.05)
        assert list(tmp_path.glob("*/0/project/tests"))
        run.send_signal(number)
        assert run.wait(timeout=60) == 128 + number
    finally:
        run.kill()
    assert list(tmp_path.iterdir()) == []

"""What is mutated, and the tests that hold it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tests.mutants import c, python
from tests.mutants.mutant import Mutant

PROJECT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Target:
    """A file and its tests.

    Attributes:
        file: relative to the root of the project.
        tests: arguments of pytest: those that are meant to hold the file, and are quick.
    """

    file: str
    tests: tuple[str, ...]

    @cache  # noqa: B019 - as many as TARGETS
    def mutants(self) -> list[Mutant]:
        """The file's mutants, by line."""
        make = c.mutants if self.file.endswith(".c") else python.mutants
        return make(self.file, (PROJECT / self.file).read_text())


CONTROLLER = ("tests/models/test_cmec_bounds.py", "tests/models/test_cmec.py", "tests/models/test_safety.py")
FOUR_STATE = (
    "tests/models/test_four_state_bounds.py",
    "tests/models/test_four_state.py",
    "tests/models/test_estimators.py",
    "-k",
    "four_state or FourState",
)
ESTIMATOR = (
    "tests/models/test_four_state_bounds.py",
    "tests/models/test_given_heading.py",
    "tests/models/test_trust.py",
    *FOUR_STATE[1:-1],
    "four_state or FourState or wrapped",
)
DRIVERS = ("tests/codegen/firmware/test_driver_bounds.py", "tests/codegen/firmware/test_onboard_drivers.py")
RADIO = (*DRIVERS, "-k", "not (captures or ubx or mt or fix or epoch or sample)")
ORDERS = "tests/harness/onboard/test_orders.py"
BOUNDS = "tests/harness/onboard/test_onboard_bounds.py"
ONBOARD = "codegen/firmware/onboard"
TARGETS = (
    Target("models/cmec.py", CONTROLLER),
    Target("models/safety.py", tuple(reversed(CONTROLLER))),
    Target("models/fence.py", ("tests/models/test_fence.py",)),
    Target("models/watchdog.py", ("tests/models/test_watchdog.py",)),
    Target("models/fuzzy.py", ("tests/models/test_fuzzy.py",)),
    Target("models/four_state.py", FOUR_STATE),
    Target("models/given_heading.py", ESTIMATOR),
    Target("models/estimator.py", ESTIMATOR),
    Target("models/inertial.py", ESTIMATOR),
    Target(f"{ONBOARD}/scanner.c", DRIVERS),
    Target(f"{ONBOARD}/ubx.c", DRIVERS),
    Target(f"{ONBOARD}/mt.c", DRIVERS),
    Target(f"{ONBOARD}/link.c", RADIO),
    Target(f"{ONBOARD}/siphash.c", (*DRIVERS, "-k", "siphash")),
    Target(f"{ONBOARD}/onboard.c", (BOUNDS, ORDERS, "-k", "not until_the_window")),
)

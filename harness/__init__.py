"""Running FMUs: trials, swaps, sweeps, replays, logs; the `canine` command, and the way in from Python.

    from harness import run_trial

    result = run_trial("three_waypoint", seed=3, parameters={"cmec.moving_deviation": 37})
    print(result.outcome, result.time_s)
    speed = result.log.frames()["plant"]["speed"]     # a pandas Series over time in s

Nothing is imported before it is used: `import harness` costs next to nothing.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.front_door import (
        Log,
        ReplayResult,
        Scenario,
        Setting,
        SweepResult,
        TrialResult,
        load_scenario,
        open_log,
        run_replay,
        run_sweep,
        run_trial,
        scenarios,
    )

__all__ = [
    "Log",
    "ReplayResult",
    "Scenario",
    "Setting",
    "SweepResult",
    "TrialResult",
    "load_scenario",
    "open_log",
    "run_replay",
    "run_sweep",
    "run_trial",
    "scenarios",
]

if not TYPE_CHECKING:  # type checkers see the names above, and refuse others

    def __getattr__(name: str) -> object:
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from harness import front_door  # noqa: PLC0415 - on first use

        return getattr(front_door, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})

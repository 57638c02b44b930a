"""Running FMUs: trials, swaps, sweeps, replays, studies, logs; the `canine` command; the way in from Python.

    from harness import run_trial

    result = run_trial("three_waypoint", seed=3, parameters={"cmec.moving_deviation": 37})
    print(result.outcome, result.time_s)
    speed = result.log.frames()["plant"]["speed"]     # a pandas Series over time in s

Nothing is imported before it is used: `import harness` costs next to nothing.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.front_door import (
        DayResult,
        Disturbance,
        EndedByFaultError,
        FaultsResult,
        FitResult,
        Log,
        LogComparison,
        MatrixResult,
        PlanResult,
        Recovery,
        ReplayResult,
        Scenario,
        Setting,
        StudyResult,
        SweepResult,
        TrialResult,
        TuneResult,
        compare_logs,
        load_scenario,
        open_log,
        recover_log,
        run_day,
        run_faults,
        run_fit,
        run_matrix,
        run_plan,
        run_replay,
        run_study,
        run_sweep,
        run_trial,
        run_tune,
        scenarios,
    )

__all__ = [
    "DayResult",
    "Disturbance",
    "EndedByFaultError",
    "FaultsResult",
    "FitResult",
    "Log",
    "LogComparison",
    "MatrixResult",
    "PlanResult",
    "Recovery",
    "ReplayResult",
    "Scenario",
    "Setting",
    "StudyResult",
    "SweepResult",
    "TrialResult",
    "TuneResult",
    "compare_logs",
    "load_scenario",
    "open_log",
    "recover_log",
    "run_day",
    "run_faults",
    "run_fit",
    "run_matrix",
    "run_plan",
    "run_replay",
    "run_study",
    "run_sweep",
    "run_trial",
    "run_tune",
    "scenarios",
]


def _drop_missing_backend() -> None:
    """Unset MPLBACKEND if it names a module that is not here: it ends every import of matplotlib."""
    import os  # noqa: PLC0415 - on first use
    from importlib.util import find_spec  # noqa: PLC0415

    scheme, _, module = os.environ.get("MPLBACKEND", "").partition("://")
    if scheme == "module" and find_spec(module.partition(".")[0]) is None:
        del os.environ["MPLBACKEND"]


if not TYPE_CHECKING:  # type checkers see the names above, and refuse others

    def __getattr__(name: str) -> object:
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        _drop_missing_backend()
        from harness import front_door  # noqa: PLC0415 - on first use

        return getattr(front_door, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})

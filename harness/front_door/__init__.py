"""Guided Canine from Python; `from harness import run_trial` and so on come from here.

Each function does what the command of its name does, and leaves the same files. Angles are in degrees, as in
scenarios; logs and results are in SI. Errors that a user can cause are `models.errors.CanineError`.

`trials` runs them one by one, `series` many, `logs` reads what they leave, `routes` plans their ways,
`studies` repeats the dissertation's studies. `arguments` checks what they are all given.
"""

from harness.front_door.logs import (
    FitResult,
    ReplayResult,
    TuneResult,
    compare_logs,
    open_log,
    recover_log,
    run_fit,
    run_replay,
    run_tune,
)
from harness.front_door.routes import PlanResult, run_plan
from harness.front_door.series import DayResult, MatrixResult, SweepResult, run_day, run_matrix, run_sweep
from harness.front_door.studies import StudyResult, run_study
from harness.front_door.trials import (
    FaultsResult,
    TrialResult,
    load_scenario,
    run_faults,
    run_trial,
    scenarios,
)
from harness.log.compare import LogComparison
from harness.log.log import Log
from harness.log.recover import Recovery
from harness.trial.scenario import Disturbance, Scenario, Setting
from harness.trial.trial import EndedByFaultError

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

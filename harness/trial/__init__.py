"""A trial, from what a user writes to the files that it leaves.

In: a scenario (TOML, or `Scenario`), a package, or the log of an earlier trial; swapped FMUs; overrides.
Out: a folder with trial.mcap (the log), summary.json, trial.html and trial.png.
On the way, one file each: `scenario` as written, `request` what is asked for, `plan` the scenario in SI,
`prepare` the open package with its swaps and plan, `trial` the run, `contents` what goes into its log.
With the plan: `pairs` of vectors that need each other, `notes` on what cannot act.
From the log alone: `summary`, `disturbances`, and `plots` with `labels`. `firmware` picks the parameters that
the firmware takes.
"""

from typing import Literal

ReadingName = Literal["calibrated", "literal", "field", "guarded"]  # READINGS, which takes CasADi to import
DEFAULT = "three_waypoint"  # the scenario that is run unless another is named

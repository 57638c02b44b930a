"""Tunes an estimator's noise to a recording: Q and R from its innovations.

In: a recording (`harness.recording` has the formats), or a trial's log. Out: tune.toml with parameters for a
scenario or a replay, tune.json, tune.png.

`likelihood` runs the estimator over the recording and gives the likelihood of its innovations. `fit` makes it
as large as it gets, with confidence intervals. `judge` measures the parameters before and after. `tune` fits
on the first half of the recording and judges on the second. `report` writes files, picture and tables.
"""

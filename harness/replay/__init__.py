"""Replays: estimators over recorded sensors, with simulated GPS outages.

In: a recording (`harness.recording` has the formats), a folder of them, or a trial's log. Out: outages.json
and replay.png.

`source` makes sensor signals of a recording (`harness.recording`) or of a log, and `windows` chooses the
outages that can be judged. `comparison` holds the estimators and their configurations, which run in C, or as
FMUs (`fmu`). `replay` runs them through the outages and compares them with the withheld fixes; `several` does
so for each recording below a folder.
`plots` draws paths and errors.
"""

OUTAGE_S = (1.0, 600.0)  # s without GPS: the least and the most
EVERY_S = (0.25, 3600.0)  # s from one outage's start to the next: the least and the most

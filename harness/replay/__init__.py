"""Replays: an estimator's FMU over recorded sensors, with simulated GPS outages.

In: a recording (`harness.recording` has the formats), a folder of them, or a trial's log. Out: outages.json
and replay.png.

`source` makes sensor signals of a recording (`harness.recording`) or of a log, and `windows` chooses the
outages that can be judged. `replay` runs the estimator through them and compares it with the withheld fixes;
`several` does so for each recording below a folder.
`plots` draws paths and errors.
"""

OUTAGE_S = (1.0, 600.0)  # s without GPS: the least and the most
EVERY_S = (0.25, 3600.0)  # s from one outage's start to the next: the least and the most

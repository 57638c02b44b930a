"""Replays: an estimator's FMU over recorded sensors, with simulated GPS outages.

In: the folder of a recording (u-blox, IMU, time tags), or a trial's log. Out: outages.json and replay.png.

`harness.recording` reads the folder and turns it into the estimator's sensor signals at 25 Hz. `replay` runs
the estimator through outages and compares it with the withheld fixes. `plots` draws the paths.
"""

OUTAGE_S = (1.0, 600.0)  # s without GPS: the least and the most
EVERY_S = (0.25, 3600.0)  # s from one outage's start to the next: the least and the most

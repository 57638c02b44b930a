"""Recordings: a GPS receiver's and an IMU's data as files have them, and as sensor signals on the ticks.

In: the folder of a recording. Out: a `Recording`, both sensors on one clock, and its `SensorSignals`.

`read` chooses the reader by what lies in the folder. A reader of a format finds fixes on GPS time (a
`FixStream`) and inertial samples on the clock of the IMU (a `SampleStream`); `recording` joins the two. `ubx`
reads a u-blox receiver's stream, `imu_csv` a table of samples, `tags` the time tags that tie their clocks.
`signals` resamples a recording to ticks; `attitude` filters it and finds roll, pitch and heading.
"""

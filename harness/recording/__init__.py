"""Recordings: a GPS receiver's and an IMU's data as files have them, and as sensor signals on the ticks.

In: a recording, README.md here has its formats. Out: a `Recording`, both sensors on one clock, and its
`SensorSignals`; and what `canine check` says of it.

`find` sees what a recording consists of. A reader of a format finds fixes on GPS time (a `FixStream`) or
inertial samples on the clock of the IMU (a `SampleStream`); `recording` joins the two; `read` does it all.
`ubx` reads the fixes of a u-blox receiver, `esf` the samples of its own IMU, `pos` a solution of RTKLIB's,
`imu_csv` a table of samples, `xsens` the stream of an MT, `described` what a recording.toml names (with
`mounting`), `velocity` has the velocities that a receiver did not send, `tags` the time tags that tie clocks.
`check` looks at a recording, and `agreement` at whether its sensors agree. `signals` resamples a recording to
ticks; `attitude` filters it and finds roll, pitch and heading. `positions` has paths to drive trials with.
"""

STREAMS = (".ubx", ".log", ".bin")  # a u-blox receiver's bytes

"""The operator's station: a laptop, a browser or none, and a vest at the end of a radio.

In: bytes of a port (a radio at a serial port, TCP, a simulated vest, a log), what operators order. Out: bytes
to the port, what is shown, a log.

`draft` is a mission as it is drawn, `mission_files` and `formats/` read and write it. `ports` carries bytes.
`desk` knows who commands, `conduct` turns orders into frames and telemetry into a state, `alarms` and
`quality` judge it: these four are stepped with the time, and know no socket. `session` joins them to a port
and to the `sink`, which writes the log; `playback` plays one. `shown` is what both give to browsers, with the
`history` for who comes late; `readings` are a telemetry in its units. `server` serves either, as README.md
states, past the `guard`; `headless` does without one. `proposals` asks `canine plan` for routes. `opening`
opens it all, and reports at the end.
"""

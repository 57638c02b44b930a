"""Co-simulation: FMUs, ours or foreign, run together as one system.

In: an SSP package or FMUs, start values, events. Out: rows of all inputs and outputs, tick by tick.

`archive` unpacks packages and reads XML safely. `ssp` reads a package into components and links, `fmu` loads
an FMU and prepares calls of its functions. `roles` checks a foreign FMU against a role and puts it in the
role's place. `wiring` checks the links and orders the components, `layout` gives every value its place in
memory, `calls` lists the calls of a tick, `walk` makes them (from C: `walk.c`), `recorder` keeps the last
rows and the call that is being made, `loop` runs a trial; `stepping` holds the options of stepping. `worker/`
runs FMUs that others built in a process of their own.
"""

"""Firmware: the onboard program as C, from models and hand-written drivers, and its images for processors.

In: the blocks' declarations, parameters, `onboard/` (hand-written C), a target. Out: a bundle of sources with
Makefile and README, or an image with the processor in the loop.

`targets` names the processors and `bundle` makes their sources. `telemetry` states the telemetry once.
`record` names every word of the program's memory, from the structs that `structs` reads in the headers.
`image`, `cortex_m4f` and `rabbit4000` compile. `onboard/costs.json` holds the measured cost of a tick.
"""

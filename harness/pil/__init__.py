"""Processor in the loop: the firmware on a simulated processor against this machine's, bit by bit.

In: a scenario and a target. Out: pil.json with the cost of a tick, beside the trial's files. Processors that
differ are an error.

`compare` runs the trial on both processors, compares every tick and reports the costs. `printed_defuzzifier`
measures, for comparison, the defuzzifier as the dissertation prints it.
"""

SCENARIO = "patrol"  # 110 s with an outage, the operator's stop and a lost link

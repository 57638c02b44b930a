"""The processor in the loop: the firmware on a simulated processor against this machine's, bit by bit."""

SCENARIO = "patrol"  # 110 s with an outage, the operator's stop and a lost link

"""A vest in real time: the onboard program, an animal and instruments, paced by the clock.

In: a scenario; its mission and orders are not given, they come by radio, as from any operator. Out: the bytes
of the radio at a port, the animal's true state, a log.

`pace` has a tick made when its time has come, and counts deadlines that were missed. `port` is the end of a
radio's line. `worn` is the computer on board with its port in the loop. `vest` opens it all and runs it in a
thread.
"""

SPEEDS = 0.05, 100.0  # trial time over the clock's, at least and at most
TARGETS = ("host", "cortex-m4f")  # processors that keep up with the clock

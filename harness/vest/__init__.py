"""A vest in real time: the onboard program, an animal and instruments, paced by the clock.

In: a scenario; its mission and orders are not given, they come by radio, as from any operator. Out: the bytes
of the radio at a port, the animal's true state, a log.

`pace` has a tick made when its time has come, and counts deadlines that were missed. A `port` is the end of a
radio's line: in this process, or by `pty_port` and `tcp_port` for other programs; `radio_port` opens what a
user asks for. `worn` is the computer on board with its port in the loop, `host_process` its program as a
process of its own, `board_on_lines` a simulated board. `vest` opens it all and runs it in a thread.
"""

SPEEDS = 0.05, 100.0  # trial time over the clock's, at least and at most
TARGETS = ("host", "cortex-m4f", "stm32f405")  # processors that keep up with the clock
BY_CLOCK = ("stm32f405",)  # those whose time is the clock's alone

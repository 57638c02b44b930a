"""FMUs that others built run in a process of their own: whatever they do ends in an error that names it.

All instances and the loop are in the worker, so nothing crosses a process within a tick. Rows, and which call
is being made, lie in memory that both processes see; the parent has the log, the terminal and the signals.
It is protection against faults, not against malice: the worker has the user's rights.
"""

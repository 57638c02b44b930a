"""Co-simulation masters of others, each a program that runs a package and saves the outputs that it sees.

`python -m tests.peers.ecos PACKAGE.ssp JOB.json ROWS.npy`: the job has `step` [s], `ticks`, and `outputs`,
each [component, variable, type]. ROWS gets (ticks + 1, outputs) of float64: at the start, then after each
step. Each runs in a process of its own: they are C++, and one that crashes must not end the tests.
"""

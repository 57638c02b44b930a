"""Wired systems at native speed: many trials in a call, or one long run over arrays.

`batch`, in: a system, the variables to vary and to observe, then values, points and seeds. Out: the last tick
of each trial and the observed values after it, with the bits that the blocks give one by one.

`series`, in: a block or a system, its signals and parameters. Out: what is observed, on each tick. `loop`
writes its C, which calls the blocks' step functions in turn.

Behind `batch`, `pruning` finds what the observed variables depend on. `lanes` joins the blocks' updates to an
ordinary tick without branches, `graph` simplifies its expressions, and `sources` writes the runner's C.
"""

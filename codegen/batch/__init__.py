"""Many trials at native speed: a wired system of blocks becomes a library that runs thousands in a call.

In: a system, the variables to vary and to observe, then values, points and seeds. Out: the last tick of each
trial and the observed values after it, with the bits that the blocks give one by one.

`batch` is the way in. `pruning` finds what the observed variables depend on. `lanes` joins the blocks'
updates to an ordinary tick without branches, `graph` simplifies its expressions, and `sources` writes the
runner's C.
"""

"""Blocks to C: a class of `models/` becomes a header with its struct, and a source file with its tick.

In: a block and a precision. Out: the text of `<block>.h` and `<block>.c`, the same bytes for the same block.

`block_c` makes the files from templates. `nodes` reads traced functions as graphs of operations.
`expressions` writes nodes as C, `statements` the results of an update, `decisions` the rows of a state
machine, and `layout` breaks lines.
"""

"""Pages that answer: a log, or two, as one interactive page that needs no other file and no network.

In: logs of trials. Out: HTML, with all scripts and styles inside. The parts that draw it are in `parts/`;
README.md in this folder describes them.
"""

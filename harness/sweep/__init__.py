"""Sweeps: many trials at each value of one or two parameters, at native speed.

In: scenarios, and ranges of parameters. Out: sweep.csv, sweep.png and recommendation.json.

`sweep` resolves the options of `canine sweep`, runs the trials and writes the results. `chunks` cuts the
trials into chunks and runs them on this machine's cores or a Dask cluster. `journal` keeps the chunks that
are done, so that an interrupted sweep can go on. `tls` has the certificates of a cluster. `table` turns
counts into rates and times, `recommend` names the best points with statistical confidence, `plots` draws
them.
"""

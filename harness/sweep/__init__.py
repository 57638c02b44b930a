"""Sweeps and matrices: many trials at each value of a parameter, or of each controller with each plant.

In: scenarios, and ranges of parameters, or names of controllers and plants. Out: sweep.csv, sweep.png and
recommendation.json; matrix.csv, matrix.png and matrix.json.

`sweep` resolves the options of `canine sweep`, runs the trials and writes the results; `matrix` those of
`canine matrix`. Both use `axis`, a varied parameter; `components`, what takes which role's place; `trials`,
scenarios resolved to trials; and `run`, from where a journal left off. `chunks` cuts the trials into chunks
and runs them on this machine's cores or a Dask cluster; `cells` joins the jobs of a matrix to one,
`cosimulated` runs those with FMUs of others. `journal` keeps the chunks that are done, so that an
interrupted sweep can go on. `tls` has the certificates of a cluster. `table` turns counts into rates and
times, `paired` compares cells trial by trial, `recommend` names the best points with statistical
confidence, `plots` and `matrix_plots` draw them.
"""

"""Fits: an animal's statistics (Table 5.1) from the logs of its trials.

In: logs of trials, simulated or real. Out: fit.json, fit.png, and fit.toml with parameters for a scenario.

`tracks` reads one trial: speeds, turn rates, drift, and the response to each command. `estimate` reads the
logs, pools the trials and gives confidence intervals. `report` writes the files, the picture and the table.
"""

"""The log of a run: an MCAP file with one topic for each component, and topics that viewers draw.

In: batches of rows, the scenario and parameters, the package. Out: trial.mcap, and its values read back.

`writer` takes batches of rows and decides when they reach the disk. `rows` spells them as JSON, `foxglove`
draws map, 3D and events, `container` lays messages out in MCAP. `channel` describes a component's signals.
`log` reads a log, also one that was cut short, and `contents` checks its records. `route` finds its
waypoints, `geodesy` turns metres into latitudes, `export` writes CSV and Parquet. `compare` says where two
logs differ, `comparison_table` prints it; `recover` makes a log whole that was cut.
"""

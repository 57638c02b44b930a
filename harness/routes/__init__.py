"""Routes round buildings: ways over a map, waypoints along them, and how often the dog gets there by each.

In: a map with no-go areas and streets, two places on it, and a scenario: its dog and its controller. Out: the
routes between which success, time, stimuli and no-go areas leave a choice; a scenario and a mission of the
recommended one.

`site` is the map in metres, `map_file` reads it. `open_ground` finds ways round the areas, `streets` those
along lines; both give a `way`. `candidates` puts waypoints along ways. `score` has the candidates tried by
many simulated trials, in which the batch runner watches the areas. `plan` resolves what is asked for and
chooses, `report` writes the results, `picture` draws them.
"""

MAPS = ("geojson", "json", "kml")  # endings of files

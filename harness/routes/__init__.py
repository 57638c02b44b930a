"""Routes round buildings: ways over a map, waypoints along them, and how often the dog gets there by each.

In: a map with no-go areas and streets, two places on it, and a scenario: its dog and its controller. Out: the
routes between which success, time, stimuli and no-go areas leave a choice; a scenario and a mission of the
recommended one.

`site` is the map in metres, `map_file` reads it. `open_ground` finds ways round the areas, `streets` those
along lines; both give a `way`. `candidates` puts waypoints along ways. `score` has the candidates tried by
many simulated trials, in which the batch runner watches the areas. `problem` resolves what is asked
for, `halving` has the candidates tried and chooses, `report` writes the results, `picture` draws them.
"""

import importlib.util
from typing import Literal

from models.errors import UsageError

MAPS = ("geojson", "json", "kml")  # endings of files
Along = Literal["open", "streets", "both"]
CLEARANCES = (3.0, 6.0, 9.0)  # m
SPACINGS = (None, 12.0, 15.0, 20.0, 25.0)  # m
WAYS = 4
LONGEST = 2.0  # times the shortest way
TRIALS = 4096  # of each candidate that is left at the end


def require_packages() -> None:
    """Are the packages there that a plan needs?

    Raises:
        UsageError: they are not.
    """
    lacks = [name for name in ("networkx", "shapely", "fastkml") if not importlib.util.find_spec(name)]
    if lacks:
        raise UsageError(f'canine plan needs {", ".join(lacks)}; pip install "guided-canine[routes]"')

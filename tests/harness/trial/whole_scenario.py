"""A scenario that has every key."""

WHOLE = """
system = "cts"
reading = "literal"
seed = 7
duration = 60
waypoints = [[25, 0], [25, -12.5]]
origin = { latitude = 32.5, longitude = -85.25 }
start = { north = 1, east = 2, heading = 90 }
[parameters]
"cmec.moving_deviation" = 37
"controller.max_turns" = 3
"canine.shaking" = false
[[set]]
at = 10.0
until = 12.5
"controller.override" = "STOP"
"cmec.link_ok" = false
[[fault]]
signal = "plant.heading"
kind = "offset"
at = 10.0
until = 12
value = 5
[[fault]]
signal = "radio"
kind = "lost"
at = 20.0
"""

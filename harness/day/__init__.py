"""A dog's day: missions in a row with rests, many days at a time, each lane of the batch runner a dog.

In: a scenario, controllers, rests. Out: success, fatigue and habituation by mission, as table, picture, page
and JSON.

`missions` resolves what is asked for and runs it: the dog's final states become the next mission's start,
after the rest that `models.day.rested` states. `picture` draws the curves, `report` writes the results.
"""

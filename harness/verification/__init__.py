"""Verification: our trials against the dissertation's; `python -m harness.verification` makes the pages.

In: the models, and the numbers in the dissertation's text. Out: results/verification.md with its pictures,
results/streets.md, results/controllers.md and results/habituation.md.

`published` states the dissertation's numbers. `runs` simulates the trials, `tables` and `pictures` compare
the two, `page` puts everything into templates/verification.md.jinja. `streets` makes the page on streets and
poles, whose maps are ours; `controllers` makes that of each controller with each dog; `habituation` that of
what the field's counts say of it, and what it makes of a straight way. The same models give
the same pages. The dissertation's results are compared with ours; no parameter is fitted to them.
"""

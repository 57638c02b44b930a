"""Verification: our trials against the dissertation's; `python -m harness.verification` makes the page.

In: the models, and the numbers in the dissertation's text. Out: results/verification.md and its pictures.

`published` states the dissertation's numbers. `runs` simulates the trials, `tables` and `pictures` compare
the two, `page` puts everything into templates/verification.md.jinja. The same models give the same page. The
dissertation's results are compared with ours; no parameter is fitted to them.
"""

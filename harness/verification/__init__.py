"""Our trials against the dissertation's: `python -m harness.verification` writes results/verification.md.

Numbers and pictures come from runs, words from templates/verification.md.jinja: the same models give the same
page. What the dissertation says is only compared with; nothing is set by it.
"""

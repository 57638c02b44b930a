"""Studies that repeat those of Chapter 3 and Appendices B to D: `canine study NAME`.

In: the study's name, how many seeds, a set of sensors and pack, a recording where one is studied. Out, in a
folder of its own: the result as JSON, which says all that tables and pictures show, and the pictures.

`study` finds a study and carries it out. A study is a module with `run`, which gives the result as plain
data, `show`, which prints it as tables, and `draw`, which draws it. `tracking` has the trials that studies
share: along one of `paths`, with pack, sensors and any estimators, in C by `codegen.batch.series`.
`statistics` judges errors, `innovations` what an estimator says about itself, and `published` has the text's
own numbers.
"""

STUDIES = {
    "motion": "how the pack moves, by set, beside the text and a real dog (B.4, D.5)",
    "pitch": "what an incline does to an estimator that does not know of it (D.6)",
    "outage": "estimators through 10 s without GPS, beside the text's numbers (Tables 3.1, D.1, D.2)",
    "leading": "how often each estimator leads the simulated dog to its waypoints",
    "heading": "what a magnetometer does for the heading through an outage (Appendix C)",
    "tuning": "over random set-ups: where fuzzy beats a constant Q, and where pitch helps (3.3)",
    "recording": "all our estimators on a recording: outages, halves, innovations",
    "consistency": "are the estimators as good as they say: NEES, NIS, whiteness, stated deviations",
    "observability": "which motion tells an estimator's biases apart",
    "steady": "what the filter settles at, against the Riccati equation",
    "limit_cycle": "the heading under the controller, against its describing function",
}

"""The mathematics: one file per block, plus the wiring. Knows no C, no FMI, no files."""

import time

IMPORTED_AT = time.time()  # s; this process may lack what is edited later

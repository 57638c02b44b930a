"""The mathematics: one file per block, plus the wiring. Knows no C, no FMI, no files."""

"""The dissertation's own numbers, each with its place in the text; ours are compared with them."""

from __future__ import annotations

from typing import NamedTuple


class Errors(NamedTuple):
    """Errors at the end of a trial whose last 10 s were without GPS; a dog in detection mode."""

    place: str
    n: int
    position: float  # m, mean
    position_sd: float
    speed: float  # m/s, mean
    speed_sd: float


OUTAGE_S = 10.0  # without GPS (3.3.6)
INERTIAL, NO_PITCH, PITCH, FUZZY = "accelerometer and heading", "no pitch", "pitch", "fuzzy"

OUTAGE = {
    INERTIAL: Errors("Table D.1", 31, 340.4, 355.1, 39.6, 25.1),
    NO_PITCH: Errors("Table D.1", 31, 21.5, 17.2, 5.1, 4.6),
    PITCH: Errors("Tables D.1 and 3.1", 31, 11.6, 7.2, 2.8, 1.8),
    FUZZY: Errors("Table 3.1", 36, 7.5, 5.7, 1.2, 0.9),
}

# paired, 31 trials: t of position, t of speed (Table D.2)
PAIRED = {
    (INERTIAL, NO_PITCH): (4.889, 7.685),
    (INERTIAL, PITCH): (5.129, 8.212),
    (NO_PITCH, PITCH): (2.948, 2.832),
}
PAIRED_PLACE = "Table D.2"
# p of position and of speed, unpaired (Table 3.1)
UNPAIRED = {(PITCH, FUZZY): (0.0115, 0.0001)}
UNPAIRED_PLACE = "Table 3.1"

TRUE_BIAS = 0.1  # m/s2 (eq. D.14)
INCLINE_DEG = 10.0  # D.6.1
# improvement of the heading by magnetometers, in percent (C.6)
HEADING = {"pedestrian": ("Figure C.2", 10.2), "canine": ("Figure C.4", 6.3)}

"""How an IMU is mounted: the rotation from its axes into those of the body (forward, right, down)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from harness.recording.attitude import Array

SLACK = 1e-3  # the most by which a matrix that a user wrote may differ from a rotation


def rotation(roll: float, pitch: float, yaw: float) -> Array:
    """The matrix (3, 3) that turns a vector in the axes of the IMU into forward, right, down; angles in deg.

    They are the attitude of the IMU in the body, in the aerospace order: Rz(yaw) Ry(pitch) Rx(roll).
    """
    (cr, sr), (cp, sp), (cy, sy) = (_turn(angle) for angle in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, dtype=np.float64)


def rotations(roll: Array, pitch: Array, heading: Array) -> Array:
    """The matrices (n, 3, 3) of attitudes (n,) in rad: from forward, right, down to north, east, down."""
    angles = np.column_stack([heading, pitch, roll])
    return np.asarray(Rotation.from_euler("ZYX", angles).as_matrix(), dtype=np.float64)


def euler_angles(rotations: Array) -> Array:
    """Roll, pitch and heading [rad] of matrices (n, 3, 3) from forward, right, down to north, east, down."""
    sine = np.clip(-rotations[:, 2, 0], -1, 1)
    return np.column_stack(
        [
            np.arctan2(rotations[:, 2, 1], rotations[:, 2, 2]),
            np.arcsin(sine),
            np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]),
        ]
    )


def _turn(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle in deg, exact at the multiples of 90."""
    if angle % 90 == 0:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(angle // 90) % 4]
    return math.cos(math.radians(angle)), math.sin(math.radians(angle))


def fault_of_rotation(matrix: Sequence[Sequence[float]]) -> str:
    """Why a matrix (3, 3) is not a rotation; "" if it is one."""
    m = np.asarray(matrix, dtype=np.float64)
    if not (np.abs(m) <= 2).all() or not np.allclose(m @ m.T, np.eye(3), atol=SLACK):
        return "its rows are not at right angles and of length 1"
    return "it mirrors, its determinant is -1" if np.linalg.det(m) < 0 else ""

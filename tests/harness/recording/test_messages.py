"""Which messages of a u-blox receiver make a fix, and where its velocity comes from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage

from harness.recording.recording import RecordingError
from harness.recording.ubx import read_ubx
from tests.harness.recording import made_up

PLACE = {"lat": 40.0, "lon": -105.0, "height": 1_580_000, "hAcc": 3500}


def message(name: str, second: int, **fields: float) -> bytes:
    return bytes(UBXMessage("NAV", f"NAV-{name}", GET, iTOW=1000 * second, **fields).serialize())


def written(folder: Path, *messages: bytes) -> Path:
    path = folder / "gnss.ubx"
    path.write_bytes(b"".join(messages))
    return path


def sol(second: int, **fields: float) -> bytes:
    """1 m/s north and 0.5 m/s west at 40 deg north, 105 deg west, in earth-centred axes, to 1 cm/s."""
    phi, lam = np.radians(40.0), np.radians(-105.0)
    north = np.array([-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)])
    east = np.array([-np.sin(lam), np.cos(lam), 0.0])
    x, y, z = np.rint(100 * (north - 0.5 * east)).astype(int)
    velocity = {"ecefVX": int(x), "ecefVY": int(y), "ecefVZ": int(z), "sAcc": 45}
    return message("SOL", second, **({"gpsFix": 3, "gpsfixOK": 1} | velocity | fields))


def test_without_velned_the_velocity_is_that_of_nav_sol(tmp_path: Path) -> None:
    # given what a u-blox 5 or 6 sends with NAV-VELNED switched off; the last epoch is no fix
    epochs = [message("POSLLH", t, **PLACE) + sol(t) for t in range(1, 4)]
    fixes = read_ubx(written(tmp_path, *epochs, message("POSLLH", 4, **PLACE), sol(4, gpsFix=2)))
    assert len(fixes.rows) == 3
    np.testing.assert_allclose(fixes.rows[:, 4:6], [[1.0, -0.5]] * 3, atol=0.01)
    np.testing.assert_allclose(fixes.rows[:, 7], 0.45)  # the accuracy that the receiver states
    assert fixes.kinds == {"NAV-POSLLH with NAV-SOL 3D": 3}
    assert fixes.dropped == {"epochs without a three-dimensional fix": 1}


@pytest.mark.parametrize(("h_acc", "kept"), [(99_999, 2), (100_000, 1)])
def test_without_nav_sol_a_position_of_100_m_accuracy_is_no_fix(
    tmp_path: Path, h_acc: int, kept: int
) -> None:
    # given NAV-POSLLH and NAV-VELNED alone, which do not say whether there is a fix
    velned = {"velN": 200, "velE": 0, "gSpeed": 200, "sAcc": 30}
    epochs = [
        message("POSLLH", t, **(PLACE | {"hAcc": accuracy})) + message("VELNED", t, **velned)
        for t, accuracy in ((1, 3500), (2, h_acc))
    ]
    fixes = read_ubx(written(tmp_path, *epochs))
    assert len(fixes.rows) == kept
    assert sum(fixes.dropped.values()) == 2 - kept


def test_velned_goes_before_nav_sol(tmp_path: Path) -> None:
    velned = message("VELNED", 1, velN=200, velE=0, gSpeed=200, sAcc=30)
    fixes = read_ubx(written(tmp_path, message("POSLLH", 1, **PLACE), sol(1), velned))
    np.testing.assert_allclose(fixes.rows[0, 4:8], [2.0, 0.0, 3.5, 0.3])
    assert fixes.kinds == {"NAV-POSLLH with NAV-VELNED 3D": 1}


def test_positions_without_any_velocity_say_what_to_switch_on(tmp_path: Path) -> None:
    path = written(tmp_path, *(message("POSLLH", t, **PLACE) for t in range(3)))
    with pytest.raises(RecordingError, match="NAV-POSLLH without a velocity; switch on NAV-PVT, or NAV-SOL"):
        read_ubx(path)


def test_nav_pvat_gives_the_fix_of_nav_pvt(tmp_path: Path) -> None:
    fields = {"velN": 1000, "velE": -500, "gSpeed": 1118, "sAcc": 150, "fixType": 4, **PLACE}
    pvt = message("PVT", 1, validTime=1, gnssFixOk=1, headMot=333.4, **fields)
    pvat = message("PVAT", 1, validTime=1, gnssFixOK=1, motHeading=333.4, **fields)
    expected, got = read_ubx(written(tmp_path, pvt)), read_ubx(written(tmp_path, pvat))
    np.testing.assert_array_equal(got.rows, expected.rows)
    assert got.kinds == {"NAV-PVAT 3D with dead reckoning": 1}
    # and one that the receiver does not call good is none
    with pytest.raises(RecordingError, match="1 fixes that the receiver does not call good"):
        read_ubx(written(tmp_path, message("PVAT", 1, validTime=1, gnssFixOK=0, motHeading=333.4, **fields)))


def test_kinds_of_fixes_are_counted(tmp_path: Path) -> None:
    common = {"validTime": 1, "gnssFixOk": 1, "fixType": 3, "sAcc": 100, **PLACE}
    carriers = (0, 1, 2, 2)
    messages = [message("PVT", t, carrSoln=carrier, **common) for t, carrier in enumerate(carriers)]
    fixes = read_ubx(written(tmp_path, *messages, made_up.frame(b"\x01\x07", b"")))
    assert fixes.kinds == {"NAV-PVT 3D": 1, "NAV-PVT 3D RTK float": 1, "NAV-PVT 3D RTK fixed": 2}

"""A station in the browser ends at a signal, once its files are written."""

from __future__ import annotations

import signal
import subprocess
import sys
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_station_that_has_served_a_page(number: signal.Signals, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "harness.main", "station", "--simulate", "three_waypoint"]
    command += ["--no-browser", "--http-port", "0", "--out", str(tmp_path)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as station:
        try:
            assert station.stdout is not None
            address = urlsplit(station.stdout.readline().split()[0])
            connection = HTTPConnection(address.netloc, timeout=60)
            connection.request("GET", "/static/station.js")
            assert connection.getresponse().read()
            connection.close()
            station.send_signal(number)
            _, printed = station.communicate(timeout=120)
        finally:
            station.kill()
    assert station.returncode == 128 + number
    assert printed.splitlines()[-1].endswith(f"the log is in {tmp_path}")
    assert {path.name for path in tmp_path.iterdir()} == {"trial.mcap", "summary.json", "trial.html"}

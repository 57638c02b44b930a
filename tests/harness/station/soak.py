"""Missions in a row for hours of a vest's time: python -m tests.harness.station.soak --hours 2 --speed 20.

One client commands, another watches behind a slow link. At intervals a line tells the memory of the process
(station, vest and both clients), how long after the vest sent a telemetry the commander had it, how many
telemetries are not in the log, and what the watcher was skipped. Exit status 1 if a demand is not met.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
import time
from array import array
from bisect import bisect_right
from pathlib import Path
from typing import Any

import numpy as np

from harness.log.log import FILE, read_log
from harness.onboard.radio import Decoder
from harness.station.shown import News
from models.commands import Status
from tests.harness.station.browser import Browser, Served, simulated
from tests.harness.station.dogs import TURN, obedient
from tests.harness.station.slow import SlowWatcher

DELAY_S = 0.3  # of a telemetry, at most
GROWTH_MIB = 20  # of the process after the first tenth
RATE = 4000  # bytes a second that the watcher takes
INTERVALS = 12
PATIENCE_S = 600.0


class Sent:
    """What a vest sends, and when; it stands between the vest and its radio.

    Attributes:
        times: ms of the vest's clock, of each telemetry; one session.
        at: s of this machine's clock, when each was sent.
    """

    def __init__(self, vest: Any) -> None:
        self._write, self._decoder = vest._worn._radio.write, Decoder(None)
        self.times, self.at = array("q"), array("d")
        vest._worn._radio.write = self._send

    def _send(self, data: bytes) -> None:
        for _, telemetry in self._decoder.receive(data):
            self.times.append(telemetry.time_ms)
            self.at.append(time.monotonic())
        self._write(data)

    def upto(self, state: dict[str, Any]) -> int:
        """So many telemetries were sent up to the one that a state shows."""
        return bisect_right(self.times, round(1000 * state["telemetry"]["time"]))

    def age(self, state: dict[str, Any]) -> float:
        """How long ago the telemetry was sent that a state shows, s; 0 for none."""
        upto = self.upto(state) if state["telemetry"] else 0
        return time.monotonic() - self.at[upto - 1] if upto else 0.0


class Commander(Browser):
    """It notes when each telemetry is shown: a later one shows it, too.

    Attributes:
        delays: s, of each telemetry so far.
        states: that came.
    """

    def __init__(self, socket: Any, sent: Sent) -> None:
        self._sent, self._shown = sent, 0
        self.delays, self.states = array("d"), 0
        super().__init__(socket)

    def _take(self, message: dict[str, Any]) -> None:
        super()._take(message)
        self.states += message["is"] == "state"
        if message["is"] == "state" and message["telemetry"]:
            now, upto = time.monotonic(), self._sent.upto(message)
            self.delays.extend(now - at for at in self._sent.at[self._shown : upto])
            self._shown = max(self._shown, upto)
        del self.events[:-20]


def memory() -> float:
    """MiB that the process holds."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class Soak:
    """Missions in a row.

    Attributes:
        outcomes: how many missions ended how.
        held: MiB at the end of each interval.
        own: s of the processor that the longest look at the port took; longer delays are the machine's.
    """

    def __init__(self, station: Served, commander: Commander, slow: SlowWatcher, until: float) -> None:
        self.station, self.commander, self.slow, self.until = station, commander, slow, until
        self.outcomes: dict[str, int] = {}
        self.held: list[float] = []
        self._told = 0  # delays that were
        self.own = 0.0  # s of the processor that the longest look at the port took
        poll = station.shown.poll

        def timed() -> News:
            begun = time.thread_time()
            news = poll()
            self.own = max(self.own, time.thread_time() - begun)
            return news

        station.shown.poll = timed  # type: ignore[method-assign]

    @property
    def is_over(self) -> bool:
        """Has the vest's clock come to the end?"""
        return bool(self.station.vest.state.time >= self.until)

    def run(self) -> None:
        """Lead missions until it is over; a line at each interval."""
        self.commander.load()
        while not self.is_over:
            self.commander.do("start")
            self._until("running")
            self.commander.until(
                lambda: self._tells() and self.commander.state["link"] != "running", PATIENCE_S
            )
            status = Status(self.commander.state["telemetry"]["status"]).name
            self.outcomes[status] = self.outcomes.get(status, 0) + 1
            self.commander.do("abort")
            self._until("ready")

    def _until(self, link: str) -> None:
        self.commander.until(lambda: self.commander.state["link"] == link, PATIENCE_S)

    def _tells(self) -> bool:
        """True; a line if an interval has passed."""
        if self.station.vest.state.time >= self.until * (len(self.held) + 1) / INTERVALS:
            self.held.append(memory())
            recent, self._told = self.commander.delays[self._told :], len(self.commander.delays)
            delays = " ".join(f"{delay:.3f}" for delay in np.percentile(recent, (50, 99, 100)))
            slow, quality = self.slow, self.commander.state["link_quality"]
            parts = [f"{self.station.vest.state.time:6.0f} s", f"{self.outcomes}", f"{self.held[-1]:.0f} MiB"]
            parts += [f"delay {delays} s (p50 p99 max)", f"lost {quality['lost']}, late {quality['late']}"]
            parts.append(
                f"slow: {slow.states} of {self.commander.states} states, {slow.oldest:.1f} s old at most"
            )
            parts.append(f"{slow.left_out} messages left out {slow.ended}")
            print("; ".join(parts), flush=True)
        return True


def soak(folder: Path, hours: float, speed: float) -> list[str]:
    """Run it; the demands that were not met."""
    scenario = obedient(folder, TURN, patience=2 * speed)  # as long by this machine's clock as at its rate
    with simulated(folder / "out", speed, scenario) as station:
        sent = Sent(station.vest)
        slow = SlowWatcher(station.address, RATE)
        with station.tab(lambda socket: Commander(socket, sent)) as commander:
            run = Soak(station, commander, slow, 3600 * hours)
            watching = threading.Thread(target=slow.run, args=(lambda: run.is_over, sent.age), daemon=True)
            watching.start()
            run.run()
            print(f"the vest: {station.vest.state.account()}")
            print(f"the station took {1000 * run.own:.0f} ms of the processor at once, at most")
    log = read_log(folder / "out" / FILE)
    logged = set(np.rint(1000 * log["telemetry.time"]).astype(int).tolist()) - {0}
    first, last = min(logged), max(logged)  # before, the vest did not answer this station yet
    lost = [t for t in sent.times if first <= t <= last and t not in logged]
    growth = run.held[-1] - run.held[max(1, INTERVALS // 10)]
    print(f"{len(sent.times)} telemetries sent, {len(lost)} not in the log; memory grew by {growth:.1f} MiB")
    faults = []
    if lost:
        faults.append(f"{len(lost)} telemetries are not in the log")
    if (longest := max(commander.delays)) > DELAY_S:
        faults.append(
            f"a telemetry was shown {longest:.2f} s after it was sent, expected {DELAY_S:g} s at most"
        )
    if growth > GROWTH_MIB:
        faults.append(f"memory grew by {growth:.0f} MiB, expected {GROWTH_MIB} at most")
    if slow.ended:
        faults.append(f"the slow watcher was left: {slow.ended}")
    return faults


def main() -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=2.0, help="of the vest's time")
    parser.add_argument("--speed", type=float, default=20.0, help="the vest's time over the clock's")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        faults = soak(Path(folder), arguments.hours, arguments.speed)
    for fault in faults:
        print(f"FAILED: {fault}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())

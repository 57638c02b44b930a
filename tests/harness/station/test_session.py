"""What a station records, and that one whose port is pulled, or whose disk is full, goes on and says so."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import orjson
import pytest
from mcap.reader import make_reader

from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.telemetry import FIELDS, Flag, Telemetry
from harness.log.log import LogError, read_log
from harness.onboard.radio import Abort, Mission, Position, Seal, encode
from harness.station.desk import OrderError
from harness.station.events import Level
from harness.station.opening import vest_parameters
from harness.station.ports import PortError
from harness.station.recorded import read_recorded
from harness.station.session import OLD_HOLD_S, OLD_S, REOPEN_S, About, Session
from harness.station.shown import Refresh
from harness.station.sink import FLUSH_S, JUMP_S, ORDERS, Sink
from harness.trial.scenario import Scenario
from models.commands import Command
from models.errors import UsageError
from models.kit.timing import TICK
from models.modes import Mode
from tests.harness.onboard.vest import Vest, program
from tests.harness.station.browser import Silence
from tests.harness.station.rig import Hands, Tapped, frames

MISSION = Mission(Position(32.6, -85.4), (Position(32.6009, -85.4),))


class Pulled(Silence):
    """A port that is pulled."""

    is_closed = False

    def read(self) -> bytes:
        raise PortError("port x: is gone")

    def close(self) -> None:
        self.is_closed = True


class OnDesk(Silence):
    """A port to the program on board, which makes a tick with each look."""

    def __init__(self) -> None:
        self._processor, self._coming = Tapped(program()), b""
        self._vest = Vest(self._processor)

    def read(self) -> bytes:
        self._vest.tick(self._coming)
        self._coming = b""
        return self._processor.sent

    def write(self, data: bytes) -> None:
        self._coming += data


def session(
    folder: Path,
    port: Silence,
    hands: Hands,
    reopen: Callable[[], Silence] | None = None,
    key: Key | None = None,
) -> Session:
    about = About("x", vest_parameters(Scenario("x")))
    sink = Sink(folder, {"parameters": about.parameters})
    return Session(port, key, sink, about, reopen=reopen, clock=hands)


def texts(station: Session, hands: Hands, until: str) -> list[str]:
    """The events up to the one with a text."""
    found: list[str] = []
    end = time.monotonic() + 30
    while until not in found:
        assert time.monotonic() < end, found
        hands.now += 0.1
        found += [event.text for event in station.poll().events]
        time.sleep(0.001)
    return found


def test_a_port_that_is_pulled_is_told_and_opened_again_as_soon_as_it_can_be(tmp_path: Path) -> None:
    hands, tries = Hands(), [0]

    def reopen() -> Silence:
        tries[0] += 1
        if tries[0] < 3:
            raise UsageError("not there yet")
        return Silence()

    station = session(tmp_path, Pulled(), hands, reopen)
    found = texts(station, hands, "the port is there again")
    assert found[0] == "port x: is gone"
    assert tries[0] == 3
    assert hands.now > 3 * REOPEN_S
    station.close()


def test_a_port_that_cannot_be_opened_again_leaves_a_station_that_answers(tmp_path: Path) -> None:
    hands = Hands()
    port = Pulled()
    station = session(tmp_path, port, hands)
    assert texts(station, hands, "port x: is gone") == ["port x: is gone"]
    assert port.is_closed
    station.order(1, {"do": "stop"})
    assert station.state(station.now)["stop_latched"]
    station.close()


def test_a_log_that_cannot_be_written_stops_no_station_and_is_an_alarm(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)

    def full(now: float) -> None:
        raise LogError("log x: cannot be written (No space left on device)")

    sink = station._sink
    assert sink is not None
    sink.step = full  # type: ignore[method-assign]
    found = texts(
        station, hands, "nothing is recorded any more: log x: cannot be written (No space left on device)"
    )
    assert len(found) == 1, "it is told once"
    station.order(1, {"do": "take"})
    alarm = station.alarms(station.now)[0]
    assert (alarm.key, alarm.level) == ("log", Level.WARNING)
    station.close()


def test_a_fault_in_what_records_stops_no_station_and_is_told_once(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    sink = station._sink
    assert sink is not None
    sink._rows.append((-1.0, sink._row))  # no log has a negative time
    found = [event.text for event in station.poll().events]
    for _ in range(30):
        hands.now += 0.1
        found += [event.text for event in station.poll().events]
    lost = [text for text in found if text.startswith(f"nothing is recorded any more: {sink.path}: ")]
    assert len(lost) == 1
    station.order(1, {"do": "stop"})
    assert station.conduct.latched
    station.close()


def test_a_log_that_was_moved_is_told_once_and_goes_on(tmp_path: Path) -> None:
    # given a station at work
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    # when its log is moved
    moved = (tmp_path / "trial.mcap").rename(tmp_path / "moved.mcap")
    found: list[str] = []
    for _ in range(3):
        hands.now += FLUSH_S
        found += [event.text for event in station.poll().events]
    # then that is told, and stays an alarm
    assert len(found) == 1
    assert "was moved, removed or replaced" in found[0]
    assert [alarm.text for alarm in station.alarms(station.now) if alarm.key == "log"] == found
    # and the log has what comes thereafter
    station.order(1, {"do": "note", "text": "wet"})
    station.close()
    recorded = read_recorded(moved)
    assert any("wet" in event.text for event in recorded.events)
    assert not read_log(moved).broken


class Forged(Silence):
    """A vest without a key at which telemetry can be put.

    Attributes:
        station: that hears it.
        sent: what it was sent.
    """

    station: Session
    sent = b""

    def __init__(self) -> None:
        self._coming, self._count = b"", 0

    def put(self, time_ms: int, **told: int) -> None:
        self._count += 1
        fields = dict.fromkeys(FIELDS, 0) | told
        fields |= {"session": 7, "nonce": self.station.conduct.link.nonce, "time_ms": time_ms}
        self._coming += encode(Telemetry(**fields), self._count, Seal(None, 7))

    def read(self) -> bytes:
        data, self._coming = self._coming, b""
        return data

    def write(self, data: bytes) -> None:
        self.sent += data


@pytest.mark.parametrize(("then", "text"), [(100, "by -60.3 s"), (2**32 - 1, "by +4294906.9 s")])
def test_a_clock_of_the_vest_that_jumps_is_told_and_the_log_goes_on(
    tmp_path: Path, then: int, text: str
) -> None:
    # given a station that hears a vest
    hands, vest = Hands(), Forged()
    vest.station = station = session(tmp_path, vest, hands)
    found = []
    # when its clock jumps
    for time_ms in (60000, 60200, then, 60400, 60600):
        vest.put(time_ms)
        hands.now += 0.2
        found += [event.text for event in station.poll().events]
    station.close()
    # then each jump is told, there and back, and the log has it all
    jumps = [what for what in found if what.startswith("the vest's clock jumped")]
    assert len(jumps) == 2
    assert text in jumps[0]
    log = read_log(tmp_path / "trial.mcap")
    assert not log.broken
    assert log.time[-1] < 1.5


def test_an_hour_for_which_a_station_stood_still_is_told_and_left_out(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    hands.now += 60  # until it is served
    for _ in range(2):
        hands.now += 1
        assert not station.poll().events
    hands.now += 3600
    told = [event.text for event in station.poll().events]
    assert told == ["the station stood still for 3600 s, which the log leaves out"]
    hands.now += 1
    assert not station.poll().events
    station.close()
    log = read_log(tmp_path / "trial.mcap")
    assert not log.broken
    assert 62 < log.time[-1] < 64


def test_a_stand_still_is_told_from_that_length_on_that_a_log_leaves_out(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    for stood, is_told in ((0.0, False), (JUMP_S, False), (JUMP_S + 1, True)):
        hands.now += stood
        assert bool(station.poll().events) is is_told
    station.close()


def test_a_hold_is_recorded_once_and_again_if_it_is_ordered_after_it_lapsed(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, OnDesk(), hands, key=SIMULATION_KEY)

    def look(seconds: float) -> None:
        for _ in range(round(seconds / TICK)):
            hands.now += TICK
            station.poll()

    station.order(1, {"do": "take"})
    look(0.8)
    for _ in range(3):
        station.order(1, {"do": "hold", "command": "LEFT"})
        look(0.12)
    look(0.4)
    assert station.conduct.holding is None
    station.order(1, {"do": "hold", "command": "LEFT"})
    station.close()
    with (tmp_path / "trial.mcap").open("rb") as file:
        orders = make_reader(file).iter_messages(topics=[ORDERS])
        assert [json.loads(message.data)["do"] for *_, message in orders] == ["take", "hold", "hold"]


def test_what_is_recorded_of_an_order_is_who_gave_it_and_what_is_known_of_orders(tmp_path: Path) -> None:
    station = session(tmp_path, Silence(), Hands())
    nested: list[object] = []
    for _ in range(1000):
        nested = [nested]
    station.order(1, {"do": "note", "text": "hi", "operator": 99, "more": 1})
    station.order(2, {"do": "stop", "text": nested, "seen": nested})
    assert station.conduct.latched
    station.order(1, {"do": "take"})
    for _ in range(2):  # which comes with each stroke, and would fill the log
        station.order(1, {"do": "draft", "mission": {"home": None}})
        station.order(1, {"do": "alive"})
    station.close()
    with (tmp_path / "trial.mcap").open("rb") as file:
        found = [json.loads(message.data) for *_, message in make_reader(file).iter_messages(topics=[ORDERS])]
    assert found == [
        {"operator": 1, "do": "note", "text": "hi"},
        {"operator": 2, "do": "stop"},
        {"operator": 1, "do": "take"},
    ]


def shown(station: Session) -> float:
    """The time of a state that is shown now."""
    station._refresh = Refresh()
    state = station.poll().state
    assert state is not None
    time: float = orjson.loads(state)["time"]
    return time


def test_an_order_that_answers_a_state_of_long_ago_is_not_carried_out(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    seen = shown(station)
    hands.now += OLD_S
    station.order(1, {"do": "take", "seen": seen})
    assert station.conduct.desk.commander == 1
    for _ in range(1000):
        shown(station)
    assert len(station._seen) < 100, "a station that nobody commands keeps no more of them"
    hands.now += 0.01
    with pytest.raises(OrderError, match=r"take: came 2 s or more after what it answers was shown"):
        station.order(2, {"do": "take", "seen": seen})
    for other in (shown(station) + 1, "yesterday"):
        with pytest.raises(OrderError):
            station.order(1, {"do": "take", "seen": other})
    for nonsense in ({}, {"do": ["stop"]}):
        with pytest.raises(OrderError, match="expected one of alive"):
            station.order(2, {"seen": seen, **nonsense})
    station.close()


def test_what_is_right_at_any_time_is_carried_out_however_late_it_comes(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    station.order(1, {"do": "take"})
    seen = shown(station)
    hands.now += OLD_S + 0.01
    for order in ({"do": "release"}, {"do": "note", "text": "x"}, {"do": "stop"}, {"do": "abort"}):
        station.order(1, {"seen": seen, **order})
    station.close()


def test_the_last_state_of_a_log_is_how_it_stood_at_the_end(tmp_path: Path) -> None:
    station = session(tmp_path, Silence(), Hands())
    station.poll()
    station.order(1, {"do": "stop"})
    station.close()
    states = read_recorded(tmp_path / "trial.mcap").states
    assert [json.loads(state)["stop_latched"] for _, state in states] == [False, True]


def test_a_port_that_is_gone_is_left_alone_for_a_while(tmp_path: Path) -> None:
    hands = Hands()
    hands.now = 100.0
    station = session(tmp_path, Pulled(), hands, Silence)
    hands.now += 50
    for _ in range(2):
        station.poll()
        assert station._opening is None
        assert station._port is None
    station.close()


def heard(folder: Path, vest: Forged, hands: Hands, **told: int) -> Session:
    """A station at which operator 1 commands a vest that tells this."""
    vest.station = station = session(folder, vest, hands)
    station.join(1)
    station.order(1, {"do": "take"})
    for k in range(3):
        vest.put(1000 + 200 * k, **told)
        hands.now += 0.2
        station.poll()
    return station


class Broken(Forged):
    """A vest that is heard at a port that breaks when something is sent."""

    is_broken = False

    def write(self, data: bytes) -> None:
        super().write(data)
        if self.is_broken:
            raise PortError("port x: broke")


def test_a_port_that_breaks_with_what_is_sent_is_told_once(tmp_path: Path) -> None:
    hands, vest = Hands(), Broken()
    station = heard(tmp_path, vest, hands)
    vest.is_broken = True
    for _ in range(2):
        station.order(1, {"do": "stop"})
    assert [event.text for event in station.poll().events].count("port x: broke") == 1
    station.close()


@pytest.mark.parametrize(
    ("mode", "flags", "types"),
    [(Mode.FORWARD, Flag.STARTED, [Abort.type] * 2), (Mode.STOPPED, Flag.STARTED, []), (Mode.IDLE, 0, [])],
)
def test_a_station_that_ends_aborts_what_is_under_way_and_nothing_else(
    tmp_path: Path, mode: Mode, flags: int, types: list[int]
) -> None:
    vest = Forged()
    station = heard(tmp_path, vest, Hands(), mode=mode, flags=flags)
    vest.sent = b""
    station.close()
    assert [frame[2] for frame in frames(vest.sent)] == types


def test_a_vest_holds_a_mission_once_it_says_so(tmp_path: Path) -> None:
    for flags, on_board in ((0, None), (Flag.LOADED, {"id": 9, "mission": None})):
        station = heard(tmp_path / str(int(flags)), Forged(), Hands(), mission_id=9, flags=flags)
        assert station.state(station.now)["on_board"] == on_board
        station.close()


def test_a_mission_that_another_station_began_is_told_as_unknown(tmp_path: Path) -> None:
    hands, vest = Hands(), Forged()
    station = heard(tmp_path, vest, hands, mission_id=0x1A2B, flags=Flag.STARTED | Flag.LOADED)
    station.close()
    told = [event.text for event in read_recorded(tmp_path / "trial.mcap").events if "1a2b" in event.text]
    assert told == [
        "mission 1a2b is under way, which this station did not give: the log does not have its places"
    ]


def test_what_the_operator_orders_is_in_each_row(tmp_path: Path) -> None:
    hands, vest = Hands(), Forged()
    station = heard(tmp_path, vest, hands)
    for k, order in enumerate(({"do": "hold", "command": "LEFT"}, {"do": "stop"})):
        station.order(1, order)
        vest.put(1600 + 200 * k)
        hands.now += 0.2
        station.poll()
    station.close()
    rows = read_log(tmp_path / "trial.mcap")["controller.override"]
    assert rows[-2:].tolist() == [Command.LEFT, Command.STOP]
    assert set(rows[:-2].tolist()) == {Command.NONE}


def test_a_mission_on_board_is_recorded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    taken: list[object] = []
    monkeypatch.setattr(station._sink, "take_mission", taken.append)
    station.conduct._given = MISSION
    for _ in range(3):
        hands.now += 0.1
        station.poll()
    assert taken == [MISSION]
    station.close()


@pytest.mark.parametrize(
    ("key", "flags", "insecure"),
    [(None, 0, True), (SIMULATION_KEY, 0, False), (SIMULATION_KEY, Flag.INSECURE, True)],
)
def test_frames_are_verified_if_both_ends_have_the_key(
    tmp_path: Path, key: Key | None, flags: int, insecure: bool
) -> None:
    station = session(tmp_path, Silence(), Hands(), key=key)
    assert station.is_insecure is (key is None)
    station.conduct.telemetry = Telemetry(**dict.fromkeys(FIELDS, 0) | {"flags": flags})
    assert station.is_insecure is insecure
    station.close()


def test_an_order_and_a_leave_are_sent_at_once(tmp_path: Path) -> None:
    # given a vest that is heard, and nothing to be sent
    hands, vest = Hands(), Forged()
    station = heard(tmp_path, vest, hands)
    for act in (
        lambda: station.order(1, {"do": "hold", "command": "LEFT"}),
        lambda: station.leave(1),
        lambda: (station.join(2), station.order(2, {"do": "take"})),
        lambda: station.order(2, {"do": "stop"}),
    ):
        # when somebody orders something, or is gone, then it is sent before the next look
        vest.sent = b""
        act()
        assert vest.sent
    station.close()


def test_a_sign_of_life_that_comes_late_is_none_and_a_stop_is_obeyed_however_late(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    station.order(1, {"do": "take"})
    seen = shown(station)
    hands.now += OLD_S + 0.01
    station.order(1, {"do": "alive", "seen": seen})
    assert not station.conduct.desk.lives(station.now)
    station.order(1, {"do": "alive", "seen": shown(station)})
    assert station.conduct.desk.lives(station.now)
    station.order(2, {"do": "stop", "seen": seen})
    assert station.conduct.latched
    station.close()


def test_a_hold_over_a_slow_link_is_carried_out_and_one_that_was_held_back_is_not(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)
    station.order(1, {"do": "take"})
    seen = shown(station)
    hands.now += 0.3 + 0.2  # a round trip, and the time between two states
    hands.now += OLD_HOLD_S - 0.5 - 0.01
    with pytest.raises(OrderError, match="the vest is not heard"):  # in time: the next check refuses it
        station.order(1, {"do": "hold", "command": "LEFT", "seen": seen})
    hands.now += 0.02
    with pytest.raises(OrderError, match=r"hold: came 0\.7 s or more after what it answers was shown"):
        station.order(1, {"do": "hold", "command": "LEFT", "seen": seen})
    station.close()


def test_a_hold_that_was_held_back_moves_no_animal_while_the_logs_time_stands(tmp_path: Path) -> None:
    # given a vest that is late by more than a second, for which the log's time waits
    hands, vest = Hands(), Forged()
    station = heard(tmp_path, vest, hands)
    hands.now += 1.8
    shown(station)
    times: list[float] = []

    def look() -> float:
        vest.put(1600 + 200 * len(times))
        times.append(shown(station))
        return times[-1]

    seen, waited = look(), 0.0
    stood = station._log_clock.at(station.now)
    while waited <= OLD_HOLD_S:
        hands.now += 0.2
        waited += 0.2
        look()
    assert station._log_clock.at(station.now) == stood
    # when a hold comes that answers the first of these states, then it is refused
    with pytest.raises(OrderError, match=r"hold: came 0\.7 s or more after what it answers was shown"):
        station.order(1, {"do": "hold", "command": "LEFT", "seen": seen})
    assert station.conduct.holding is None
    # and one that answers the last of them is carried out
    station.order(1, {"do": "hold", "command": "LEFT", "seen": times[-1]})
    assert station.conduct.holding is Command.LEFT
    station.close()

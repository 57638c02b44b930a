"""The command `canine station`; `command_line` adds it."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.addresses import LOCALHOST, is_local
from harness.console import build_status, end_interrupted, json_of, out, print_note, say_where
from harness.options import Foxglove, Seed
from models.errors import UsageError

if TYPE_CHECKING:
    from harness.station.draft import Draft
    from harness.station.opening import Request
    from harness.station.session import Session
    from harness.station.shown import Shown

HTTP_PORT = 8642


@dataclass(frozen=True)
class Web:
    """Where browsers find the station; `opens` the default one by itself."""

    bind: str
    port: int
    opens: bool


def operate(
    *,
    port: Annotated[
        str, typer.Option(metavar="/dev/ttyUSB0|tcp://host:port", help="the radio: a serial device, or TCP")
    ] = "",
    simulate: Annotated[str, typer.Option(metavar="SCENARIO", help="a simulated vest and animal")] = "",
    speed: Annotated[float, typer.Option(help="with --simulate: trial time over the clock's")] = 1.0,
    seed: Seed = None,
    replay: Annotated[
        Path | None, typer.Option(metavar="LOG", exists=True, help="show a log again; no vest is commanded")
    ] = None,
    mission: Annotated[
        str, typer.Option(metavar="FILE", help="GPX, KML, GeoJSON, CSV, or a scenario: the first draft")
    ] = "",
    key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="the vest's radio key, by `canine keygen`")
    ] = None,
    headless: Annotated[
        bool,
        typer.Option("--headless", help="without a browser: upload the mission, and with --start lead it"),
    ] = False,
    start: Annotated[
        bool, typer.Option("--start", help="with --headless: start, and wait for the end")
    ] = False,
    bind: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="listen elsewhere than on this machine alone: needs a token"),
    ] = LOCALHOST,
    http_port: Annotated[int, typer.Option(min=0, max=65535, help="0 for any that is free")] = HTTP_PORT,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="print the address alone")] = False,
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, metavar="DIR", help="of the log and its summary")
    ] = None,
    foxglove: Foxglove = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the summary as JSON")] = False,
) -> None:
    """The operator's station: command a vest from the browser, and record every byte.

    \b
    canine station --simulate three_waypoint          a simulated vest; nothing else is needed
    canine station --port /dev/ttyUSB0 --key rex.key  a vest by radio
    canine station --port tcp://localhost:7700        one that `canine vest` serves
    canine station --replay out/station-three_waypoint/trial.mcap
    canine station --simulate three_waypoint --speed 20 --headless --mission three_waypoint --start

    STOP latches, and is sent again until it is cleared. It goes by radio, and reaches no farther. Once the
    browser that commands is gone the vest hears nothing, and stops the animal by its own rules.
    """
    sources = [
        name for name, value in (("--port", port), ("--simulate", simulate), ("--replay", replay)) if value
    ]
    if len(sources) != 1:
        raise UsageError(
            f"station: got {' and '.join(sources) or 'none of --port, --simulate, --replay'}; expected one "
            "of --port DEVICE, --simulate SCENARIO, --replay LOG"
        )
    if not simulate and (speed != 1.0 or seed is not None):
        raise UsageError("--speed and --seed are of a simulated vest; expected them with --simulate")
    if start and not headless:
        raise UsageError("--start: only with --headless; in the browser START is held")
    if headless and (replay or not mission):
        raise UsageError("--headless: expected --mission FILE and a vest, --port or --simulate")
    if replay and mission:
        raise UsageError(f"--mission {mission}: a log holds its own mission; expected it with a vest")
    if replay and foxglove is not None:
        raise UsageError(f"--foxglove {foxglove}: a log is opened in the viewer; expected it with a vest")
    require_extra()
    if replay:
        _play(replay, Web(bind, http_port, not no_browser))
        return
    from codegen.firmware import key as keys
    from harness.log.live import viewers_at
    from harness.station.opening import Request

    secret = keys.read(key, print_note) if key else None
    if secret is None and port:
        print_note("INSECURE: no --key: whoever has such a radio can command this vest")
    with viewers_at(foxglove, print_note) as viewers:
        request = Request(port, simulate, speed, seed, secret, folder, viewers)
        if headless:
            _lead(request, mission, start, as_json)
        else:
            _serve(request, mission, Web(bind, http_port, not no_browser), as_json)


def require_extra(what: str = "a station") -> None:
    """Are the packages there that a station, or what is served as one, needs?"""
    from importlib.util import find_spec

    lacks = [
        name
        for name in ("serial", "starlette", "uvicorn", "websockets", "gpxpy", "fastkml")
        if not find_spec(name)
    ]
    if lacks:
        raise UsageError(f'{what} needs {", ".join(lacks)}; pip install "guided-canine[station]"')


def _lead(request: Request, mission: str, start: bool, as_json: bool) -> None:
    """`canine station --headless`."""
    from harness.station.headless import Headless

    draft = _draft(mission)
    with _at_work(request, as_json) as session:
        Headless(session, lambda event: print_note(f"{event.time:.1f} s: {event.text}")).lead(
            draft, start=start
        )


def _draft(mission: str) -> Draft:
    """The mission of a file; what its reader leaves out is told."""
    from harness.station.mission_files import load

    draft = load(mission)
    for note in draft.notes:
        print_note(f"{mission}: {note}")
    return draft


@contextmanager
def _at_work(request: Request, as_json: bool) -> Iterator[Session]:
    """A station at work. However it ends, its summary and page are written; after an error none is shown.

    Building the FMUs of a simulated vest takes seconds for each.
    """
    from harness.station.opening import opened, report

    session = interrupt = None
    try:
        with ExitStack() as stack:
            with build_status("building the FMUs") as done:
                session = stack.enter_context(opened(request, print_note, done))
            yield session
    except KeyboardInterrupt as pressed:
        interrupt = pressed
    finally:  # a station that was not opened has no log: the one in its folder is an earlier one's
        summary = report(request.folder) if session else None
    if summary:
        _show(request, summary, as_json)
    if interrupt:
        kept = f"what was under way is aborted; the log is in {request.folder}"
        end_interrupted(interrupt, kept if summary else "nothing was recorded")


def _show(request: Request, summary: Mapping[str, Any], as_json: bool) -> None:
    from harness.trial.summary import show

    if as_json:
        typer.echo(json_of(summary))
    else:
        show(summary, out())
        say_where(request.folder)


def _serve(request: Request, mission: str, web: Web, as_json: bool) -> None:
    """A station in the browser, until Ctrl-C."""
    draft = _draft(mission) if mission else None
    with _listening(web) as show, _at_work(request, as_json) as session:
        if draft:
            session.conduct.draft = draft
        show(session)


def _play(log: Path, web: Web) -> None:
    """`canine station --replay`."""
    from harness.log.log import log_of
    from harness.station.playback import Playback

    with _listening(web) as show:
        show(Playback(log_of(log)))


@contextmanager
def _listening(web: Web) -> Iterator[Callable[[Shown], None]]:
    """Listen for browsers; what shows them something, until a signal ends it.

    It then raises KeyboardInterrupt with the signal's number.
    """
    from harness.station.guard import Guard
    from harness.station.server import address_of, listening, serve

    guard = Guard.of(web.bind)
    if not is_local(web.bind):
        print_note(
            f"--bind {web.bind}: HTTP is not encrypted: whoever can listen on this network sees the token; "
            "use one of your own, or a tunnel (ssh -L)"
        )
    with listening(web.bind, web.port) as listener:
        address = address_of(listener, guard)

        def ready(_: object) -> None:
            typer.echo(f"{address}   Ctrl-C ends the station")
            if web.opens:
                open_browser(address)

        def show(shown: Shown) -> None:
            import asyncio  # takes a sixth of the start of every command

            number = asyncio.run(serve(shown, guard, listener, ready))
            if number is not None:
                raise KeyboardInterrupt(number)

        yield show


def open_browser(address: str) -> None:
    """Open the default browser beside what goes on; where there is none, the address was printed."""
    threading.Thread(target=_open, args=(address,), daemon=True).start()


def _open(address: str) -> None:
    with suppress(webbrowser.Error, OSError):
        webbrowser.open(address)

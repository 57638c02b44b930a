"""The command of `canine` that runs a vest in real time; `command_line` adds it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.addresses import LOCALHOST
from harness.console import build_status, end_interrupted, err, print_note, short
from harness.options import Seed, Settings
from harness.trial import DEFAULT
from harness.vest import SPEEDS, TARGETS

if TYPE_CHECKING:
    from harness.vest.vest import State, Vest

SHOWN_S = 0.2  # s from one state that is shown to the next, on a terminal
TOLD_S = 10.0  # and where there is none


def run_vest(
    scenario: Annotated[str, typer.Argument(metavar="[SCENARIO.toml]")] = DEFAULT,
    *,
    speed: Annotated[
        float, typer.Option(min=SPEEDS[0], max=SPEEDS[1], help="trial time over the clock's")
    ] = 1.0,
    target: Annotated[str, typer.Option(help=f"one of {', '.join(TARGETS)}")] = TARGETS[0],
    seed: Seed = None,
    settings: Settings = None,
    key: Annotated[
        Path | None, typer.Option("--key", metavar="FILE", help="the vest's radio key, by `canine keygen`")
    ] = None,
    tcp: Annotated[
        int | None,
        typer.Option(min=0, max=65535, metavar="PORT", help="the radio at a TCP port, 0 for a free one"),
    ] = None,
    bind: Annotated[
        str, typer.Option(metavar="ADDRESS", help="where --tcp listens; beyond this machine with --key alone")
    ] = LOCALHOST,
    duration: Annotated[
        float | None, typer.Option(min=0.0, help="s of the trial after which it ends; by default with Ctrl-C")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, help="by default out/<scenario>-<seed>-vest")
    ] = None,
) -> None:
    """Run a vest in real time: firmware, animal and instruments, commanded by radio.

    \b
    canine vest                                   three_waypoint; the radio is a serial device, /dev/pts/7 say
    canine vest my.toml --speed 20 --key rex.key --tcp 7000
    canine vest --target stm32f405 --set sensors.gps_wander=2

    The program of `canine firmware` runs as its own process (or on a simulated processor). Whoever speaks
    to the radio commands the animal: `canine station --port` with the device or the address that is printed.
    The scenario gives animal, sensors and faults, not the mission. Ctrl-C ends it. It leaves trial.mcap.
    """
    from codegen.firmware.key import read
    from harness.log.log import FILE
    from harness.trial.request import Changes, requested
    from harness.vest.radio_port import open_radio
    from harness.vest.vest import open_vest

    secret = read(key, print_note) if key else None
    with requested(scenario, Changes(seed=seed)) as request:
        usual = request.default_folder
    interrupt: KeyboardInterrupt | None = None
    place = folder or usual.with_name(f"{usual.name}-vest")
    with (
        open_radio(tcp, bind, is_signed=secret is not None) as radio,
        build_status("building the FMUs") as built,
        open_vest(
            scenario,
            seed=seed,
            settings=settings or [],
            target=target,
            in_process=False,
            speed=speed,
            key=secret,
            radio=radio,
            duration=duration,
            out=place,
            note=print_note,
            built=built,
        ) as vest,
    ):
        try:
            typer.echo(f"radio: {radio.address}")
            if key is None:
                print_note("INSECURE: without --key it obeys whoever reaches its radio, and tells so")
            else:
                typer.echo(f"key: {short(key)}")
            _watch(vest, lambda: radio.is_open)
        except KeyboardInterrupt as pressed:
            interrupt = pressed
    log = place / FILE
    account = f"{vest.state.account()}; " + (
        f"the log is {short(log)}" if log.exists() else "nothing was logged"
    )
    if interrupt is not None:
        end_interrupted(interrupt, account)
    typer.echo(account)


def _watch(vest: Vest, is_open: Callable[[], bool]) -> None:
    """Show a vest's state until it ends."""
    with _live_line() as (show, period):
        while vest.is_running:
            show(_line(vest.state, is_open=is_open()))
            vest.wait(period)


def _line(state: State, *, is_open: bool) -> str:
    """The state in a line."""
    return (
        f"{state.time:8.1f} s  {state.command.name:<8} {state.speed:4.1f} m/s  north {state.north:7.1f} m  "
        f"east {state.east:7.1f} m  heading {round(math.degrees(state.heading)) % 360:4d} deg  "
        f"radio {'in use' if is_open else 'free':<6}  deadlines missed {state.missed}"
    )


@contextmanager
def _live_line() -> Iterator[tuple[Callable[[str], object], float]]:
    """What shows a line, and how often [s]: in the place of the last one, on a terminal."""
    if not err().is_terminal:
        yield lambda line: err().print(line, soft_wrap=True, markup=False), TOLD_S
        return
    with err().status("") as status:
        yield status.update, SHOWN_S

"""The instances of a trial: our own FMUs in this process, others' in a worker; the computer on board."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from codegen.firmware.navigation import Navigation
from codegen.firmware.targets import find_target
from fmus.archive import is_sealed
from fmus.folder import build_folder
from harness.cosim.loop import Simulation
from harness.cosim.origin import is_own, is_own_content
from harness.cosim.stepping import Loop
from harness.cosim.worker.contained import Contained
from harness.cosim.worker.simulation import Companion
from harness.log.channel import Channel
from harness.onboard import IN_FIRMWARE
from harness.onboard.garbage import Garbage
from harness.onboard.processors import Processor, open_processor
from harness.onboard.stand_in import Instrumented, Onboard
from harness.trial.firmware import firmware_values, navigation_of
from harness.trial.prepare import Prepared
from harness.trial.request import SCENARIO, Request
from models.kit.link import Values
from models.system import SYSTEMS, find_system

OpenProcessor = Callable[[str, Values, Navigation], Processor]
Kind = TypeVar("Kind", bound=Instrumented)


class Telemetry(Protocol):
    """Rows of the radio's telemetry, for the log."""

    def channel(self) -> Channel: ...

    def row(self, time: float) -> list[float]: ...


class OnboardInWorker(Onboard):
    """The onboard computer in the worker: it leaves its rows where the parent takes them."""

    width = len(Onboard.channel().names)
    rows: npt.NDArray[np.float64]

    def connect_to(self, simulation: Simulation, rows: npt.NDArray[np.float64]) -> None:
        """Read the simulation's sensors; leave the row of tick k in `rows[k % len(rows)]`."""
        self.connect(simulation.outputs("sensors"))
        self.rows = rows

    def make_tick(self, time: float) -> None:
        """One tick of the loop, and its row."""
        super().make_tick(time)
        self.rows[(self.tick - 1) % len(self.rows)] = self.row(time)


class RowsOfWorker:
    """The rows of an onboard computer that runs in the worker."""

    channel = staticmethod(Onboard.channel)

    def __init__(self, simulation: Contained) -> None:
        self._simulation = simulation

    def row(self, time: float) -> list[float]:
        """As `Onboard.row`."""
        rows = self._simulation.companion
        row: list[float] = rows[round(time / self._simulation.wiring.step) % len(rows)].tolist()
        return row


def open_simulation(
    request: Request, ready: Prepared, start: OpenProcessor, stack: ExitStack, notes: list[str]
) -> tuple[Simulation | Contained, Telemetry | None]:
    """The trial's instances at time 0, and its telemetry with firmware on board; the stack frees them.

    Args:
        start: opens the processor of `request.onboard`, given the parameters; a worker opens its own.
        notes: gets what the user should know, at the end.

    Raises:
        CanineError: an FMU, or the firmware, cannot be started.
    """
    if is_foreign(request):
        companion: Callable[[], Companion] | None = None
        width, labels = 0, {}
        if request.onboard:
            labels = {name: f"{name} on board" for name in IN_FIRMWARE if name in ready.fmus}
            companion = partial(_open, OnboardInWorker, _firmware(request, ready), open_processor)
            width = OnboardInWorker.width
        contained = Contained(
            ready.system,
            ready.fmus,
            ready.plan.values,
            request.order,
            ready.plants,
            labels=labels,
            companion=companion,
            width=width,
            loop=_loop_of(request),
            limits=request.limits,
        )
        stack.callback(lambda: notes.extend(contained.notes))
        stack.enter_context(contained)
        return contained, RowsOfWorker(contained) if request.onboard else None
    onboard = open_onboard(request, ready, start) if request.onboard else None
    simulation = simulate_here(request, ready, onboard, stack)
    stack.callback(lambda: notes.extend(simulation.notes))
    return simulation, onboard


def simulate_here(
    request: Request, ready: Prepared, onboard: Instrumented | None, stack: ExitStack
) -> Simulation:
    """The trial's instances in this process, with a computer on board in its place; the stack frees both."""
    if onboard is not None:
        stack.callback(onboard.close)
    simulation = Simulation(
        ready.system,
        ready.plan.values,
        request.order,
        plants=ready.plants,
        stand_ins=onboard.stand_ins(ready.fmus) if onboard else None,
        loop=_loop_of(request),
    )
    stack.enter_context(simulation)
    if onboard is not None:
        onboard.connect(simulation.outputs("sensors"))
    return simulation


def _loop_of(request: Request) -> Loop:
    return request.loop or ("python" if request.onboard else "native")


def is_foreign(request: Request) -> bool:
    """Does the trial run an FMU that we did not build?"""
    return not (all(is_own(path) for path in request.swaps.values()) and _is_own_package(request))


def _is_own_package(request: Request) -> bool:
    """Is the package one of ours, or a copy of it, as a log holds it?"""
    package = request.ssp.resolve()
    if build_folder().resolve() in package.parents:
        return _is_as_built(package)
    if request.scenario.system not in SYSTEMS or not package.is_file():
        return False
    copied = request.own_package
    return _is_as_built(copied) and package.read_bytes() == copied.read_bytes()


def _is_as_built(package: Path) -> bool:
    """Did we write the package, of our own FMUs alone? An exported trial may hold others."""
    if not is_sealed(package):
        return False
    with zipfile.ZipFile(package) as archive:
        fmus = set(archive.namelist()) - {"SystemStructure.ssd", SCENARIO}
        return all(is_own_content(archive.read(name)) for name in fmus)


def open_onboard(request: Request, ready: Prepared, start: OpenProcessor) -> Onboard:
    """The onboard computer with the scenario's parameters in its firmware."""
    return open_as(Onboard, request, ready, start)


def open_as(kind: Callable[..., Kind], request: Request, ready: Prepared, start: OpenProcessor) -> Kind:
    """The same as another kind, which is given the arguments of `Instrumented`."""
    return _open(kind, _firmware(request, ready), start)


@dataclass(frozen=True)
class _Firmware:
    """What the onboard computer needs: processor, estimator, origin in degrees, all values, garbage."""

    target: str
    navigation: Navigation
    origin: tuple[float, float]
    values: Mapping[str, Mapping[str, float]]
    garbage: tuple[Garbage, ...]


def _firmware(request: Request, ready: Prepared) -> _Firmware:
    navigation = navigation_of(find_system(request.scenario.system, request.scenario.estimator))
    return _Firmware(request.onboard, navigation, request.scenario.origin, ready.values, ready.garbage)


def _open(kind: Callable[..., Kind], firmware: _Firmware, start: OpenProcessor) -> Kind:
    values, navigation, target = firmware.values, firmware.navigation, firmware.target
    processor = start(target, firmware_values(values, navigation), navigation)
    try:
        pvt = find_target(target).pvt
        garbage = firmware.garbage
        return kind(processor, firmware.origin, values, pvt=pvt, navigation=navigation, garbage=garbage)
    except BaseException:
        processor.close()
        raise

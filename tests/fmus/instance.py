"""An FMU under test: fmpy's slave with variables by name, and what it has said through the logger."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import fmpy
import numpy as np
from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException

from models.kit.block import Block
from models.kit.declaration import Input, Type
from models.kit.model import Model

Refused = FMICallException
CALLS = {
    2: {"Real": "Real", "Integer": "Integer", "Boolean": "Boolean"},
    3: {"Float64": "Float64", "Int32": "Int32", "Boolean": "Boolean"},
}


class Instance:
    """One instance of an unpacked FMU, of either version."""

    def __init__(self, folder: Path) -> None:
        self.description = fmpy.read_model_description(str(folder))
        self.version = 2 if self.description.fmiVersion == "2.0" else 3
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.messages: list[str] = []
        identifier = self.description.coSimulation.modelIdentifier
        slave = fmi2.FMU2Slave if self.version == 2 else fmi3.FMU3Slave
        self.slave = slave(
            guid=self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=identifier,
            instanceName="under test",
        )
        self.slave.instantiate(**self._logger())

    def _logger(self) -> dict[str, Any]:
        if self.version == 3:
            return {
                "logMessage": lambda environment, status, category, text: self.messages.append(text.decode())
            }
        callbacks = fmi2.fmi2CallbackFunctions()

        def log(environment: Any, name: bytes, status: int, category: bytes, text: bytes) -> None:
            assert name == b"under test"
            self.messages.append(text.decode().replace("%%", "%"))

        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(log)
        return {"callbacks": callbacks}

    def __enter__(self) -> Instance:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.slave.freeInstance()

    def start(self, parameters: Mapping[str, float] | None = None, time: float = 0.0) -> Instance:
        for name, value in (parameters or {}).items():
            self[name] = value
        self.enter(time)
        self.slave.exitInitializationMode()
        return self

    def enter(self, time: float = 0.0) -> None:
        if self.version == 2:
            self.slave.setupExperiment(startTime=time)
            self.slave.enterInitializationMode()
        else:
            self.slave.enterInitializationMode(startTime=time)

    def call(self, what: str, name_or_type: str) -> Any:
        kind = self.variables[name_or_type].type if name_or_type in self.variables else name_or_type
        return getattr(self.slave, what + CALLS[self.version][kind])

    def __getitem__(self, name: str) -> float:
        return float(self.call("get", name)([self.variables[name].valueReference])[0])

    def __setitem__(self, name: str, value: float) -> None:
        native = value if self.variables[name].type in ("Real", "Float64") else int(value)
        self.call("set", name)([self.variables[name].valueReference], [native])

    def values(self, names: Sequence[str]) -> list[float]:
        return [self[name] for name in names]

    def step(self, tick: int, size: float = 0.04) -> None:
        self.slave.doStep(tick * 0.04, size)

    def state(self) -> Any:
        return self.slave.getFMUState() if self.version == 3 else self.slave.getFMUstate()

    def restore(self, state: Any) -> None:
        (self.slave.setFMUState if self.version == 3 else self.slave.setFMUstate)(state)

    def free(self, state: Any) -> None:
        (self.slave.freeFMUState if self.version == 3 else self.slave.freeFMUstate)(state)

    def to_bytes(self, state: Any) -> bytes:
        if self.version == 3:
            return bytes(self.slave.serializeFMUState(state))
        return bytes(self.slave.serializeFMUstate(state))

    def from_bytes(self, data: bytes) -> Any:
        if self.version == 3:
            return self.slave.deserializeFMUState(data)
        return self.slave.deSerializeFMUstate(data)


def bits(values: Sequence[float]) -> list[str]:
    """Values such that every differing bit shows."""
    return [ctypes.c_double(v).value.hex() for v in values]


def stimulus(block: type[Block], ticks: int, seed: int = 7) -> list[dict[str, float]]:
    """Inputs for some ticks, drawn from the declared ranges; some numbers are NaN or infinite."""
    rng = np.random.default_rng(seed)
    rows: list[dict[str, float]] = []
    held: dict[str, float] = {}
    for _ in range(ticks):
        for variable in block.variables(Input).values():
            for name in variable.flat_names:
                if variable.type is Type.REAL:
                    low, high = max(variable.min or -10.0, -10.0), min(variable.max or 10.0, 10.0)
                    held[name] = float(rng.uniform(low, high))
                    if rng.random() < 0.01:
                        held[name] = float(rng.choice([np.nan, np.inf, -np.inf]))
                elif name not in held or rng.random() < 0.1:
                    choices = [int(c) for c in variable.choices] if variable.choices else [0, 1]
                    held[name] = float(rng.choice(choices))
        rows.append(dict(held))
    return rows


def run_model(
    block: type[Block], parameters: Mapping[str, float], rows: Sequence[Mapping[str, float]]
) -> list[list[str]]:
    """The reference's outputs and states after each tick, bit by bit."""
    model = Model(block, parameters)
    model.initialize()
    names = watched(block)
    answers = [bits([model[n] for n in names])] if block.moore else []
    for row in rows:
        for name, value in row.items():
            model[name] = value
        model.step()
        answers.append(bits([model[n] for n in names]))
    return answers


def run(
    unit: Instance, block: type[Block], rows: Sequence[Mapping[str, float]], first: int = 0
) -> list[list[str]]:
    """The same of an FMU that has been started, from tick `first`."""
    names = watched(block)
    answers = [bits(unit.values(names))] if block.moore and not first else []
    for tick, row in enumerate(rows, first):
        for name, value in row.items():
            unit[name] = value
        unit.step(tick)
        answers.append(bits(unit.values(names)))
    return answers


def watched(block: type[Block]) -> list[str]:
    """Outputs and states."""
    return [*block.flat_names("output"), *block.flat_names("state")]

"""The loop with its log, beside a log that is written row by row through json and mcap's writer."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer

from harness.cosim.loop import Array, Record, Simulation
from harness.cosim.worker.contained import Contained
from harness.log.channel import Channel
from harness.log.writer import LogWriter
from harness.trial.contents import LogRows, attachments, metadata
from harness.trial.prepare import Prepared
from harness.trial.request import Request


class RowByRow:
    """The same rows in the same chunks, without the topics that viewers draw."""

    def __init__(self, file: IO[bytes], channels: Sequence[Channel]) -> None:
        self.writer: Any = Writer(file, chunk_size=2**30)
        self.writer.start()
        self.channels = []
        for channel in channels:
            schema = self.writer.register_schema(channel.block, SchemaEncoding.JSONSchema, channel.schema())
            number = self.writer.register_channel(f"/{channel.component}", MessageEncoding.JSON, schema)
            # reals have a point in JSON, Integers and Booleans have not
            kinds = [{"Real": float, "Integer": int, "Boolean": bool}[kind] for kind in channel.types]
            self.channels.append((number, channel, kinds))

    def write_rows(self, times: Array, values: Mapping[str, Array]) -> None:
        for i, moment in enumerate((times * 1e9).astype(int).tolist()):
            for number, channel, kinds in self.channels:
                typed = [
                    kind(x) for kind, x in zip(kinds, values[channel.component][i].tolist(), strict=True)
                ]
                row = json.dumps(dict(zip(channel.names, typed, strict=True)), separators=(",", ":"))
                self.writer.add_message(number, moment, row.encode(), moment)
        self.writer.flush()


def timed_run(ready: Prepared, simulation: Simulation | Contained, ticks: int, record: Record) -> float:
    """Seconds of the loop with what it hands its rows to."""
    start = time.perf_counter()
    simulation.run(ready.plan.events, duration=(ticks - 1) * simulation.wiring.step, record=record)
    return time.perf_counter() - start


def with_log(request: Request, ready: Prepared, ticks: int) -> float:
    """Seconds of the loop with the log of a trial."""
    with Simulation(ready.system, ready.plan.values) as simulation:
        return with_log_of(simulation, request, ready, ticks)


def with_log_of(simulation: Simulation | Contained, request: Request, ready: Prepared, ticks: int) -> float:
    """Seconds of a simulation with the log of its trial."""
    with tempfile.TemporaryDirectory() as folder:
        rows = LogRows(simulation, ready, None)
        with LogWriter(
            Path(folder) / "trial.mcap",
            rows.channels,
            origin=request.scenario.origin,
            metadata=metadata(request, ready),
            attachments=attachments(request, ready),
        ) as log:
            return timed_run(ready, simulation, ticks, lambda times, values: rows.write(log, times, values))


def row_by_row(ready: Prepared, ticks: int) -> float:
    """Seconds of the loop with the peer's log."""
    with tempfile.TemporaryDirectory() as folder, Simulation(ready.system, ready.plan.values) as simulation:
        channels = LogRows(simulation, ready, None).channels
        with (Path(folder) / "trial.mcap").open("wb") as file:
            return timed_run(ready, simulation, ticks, RowByRow(file, channels).write_rows)

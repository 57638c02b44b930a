"""The memory that a walk writes to: the rows of the last ticks, and the call in which it is."""

import sys
from multiprocessing import get_context
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from harness.cosim.fmu import FmuError
from harness.cosim.loop import Simulation
from harness.cosim.recorder import Position, Recorder, recorder_size
from harness.cosim.stepping import Loop
from tests.harness.cosim.test_walk import toy

DIES = "if (t > 0.99) __builtin_trap();"  # in the step from t = 1 s: tick 25


@pytest.mark.parametrize("loop", get_args(Loop))
def test_the_ring_holds_the_last_rows_wherever_the_caller_wants_them(tmp_path: Path, loop: Loop) -> None:
    # given memory for 7 rows
    with Simulation(toy(tmp_path), loop=loop) as simulation:
        memory = bytearray(simulation.recorder_size(7))
        batches: list[np.ndarray] = []
        # when
        simulation.run(
            duration=2.4, record=lambda _, values: batches.append(values["controller"].copy()), memory=memory
        )
        n = [q.name for q in simulation.columns("controller")].index("n")
    # then all rows were handed over in their order, the last 7 are still there, and nothing is being called
    counted = np.concatenate(batches)[:, n]
    assert counted.tolist() == [*range(1, 62)]
    recorder = Position.from_buffer(memory)
    assert (recorder.tick, recorder.call, recorder.rows) == (60, -1, 61)
    rows = np.frombuffer(memory, np.int32, offset=recorder_size(0, 0)).reshape(7, -1)
    place = next(i for i in range(rows.shape[1]) if rows[60 % 7, i] == 61 and rows[59 % 7, i] == 60)
    assert [rows[k % 7, place] for k in range(54, 61)] == [*range(55, 62)]


@pytest.mark.parametrize("loop", get_args(Loop))
def test_the_position_names_the_call_that_failed(tmp_path: Path, loop: Loop) -> None:
    with Simulation(toy(tmp_path, plant="if (t > 0.39) return 3;"), loop=loop) as simulation:
        memory = bytearray(simulation.recorder_size(25))
        with pytest.raises(FmuError):
            simulation.run(memory=memory)
        position = Position.from_buffer(memory)
        assert simulation.call_names[position.call] == ("plant", "fmi3DoStep")
        assert (position.tick, position.rows) == (10, 11)


def test_another_process_sees_in_which_call_one_died(tmp_path: Path) -> None:
    # given a plant that crashes, in a process of its own
    with Simulation(toy(tmp_path, plant=DIES)) as simulation:
        tick, size = simulation.call_names, simulation.recorder_size(100)
    memory = SharedMemory(create=True, size=size)
    try:
        worker = get_context("spawn").Process(target=_run, args=(tmp_path, memory.name))
        # when
        worker.start()
        worker.join()
        assert memory.buf is not None
        position = Position.from_buffer_copy(memory.buf)
    finally:
        memory.close()
        memory.unlink()
    # then
    assert worker.exitcode is not None
    assert worker.exitcode < 0
    assert (position.tick, position.rows) == (25, 26)
    assert tick[position.call] == ("plant", "fmi3DoStep")


def _run(folder: Path, name: str) -> None:
    sys.stderr.close()
    memory = SharedMemory(name)
    with Simulation(toy(folder, plant=DIES)) as simulation:
        simulation.run(memory=memory.buf)


def test_memory_without_room_for_a_row_is_refused() -> None:
    with pytest.raises(ValueError, match="has 79 bytes; expected 88 or more for a row"):
        Recorder(40, bytearray(79))

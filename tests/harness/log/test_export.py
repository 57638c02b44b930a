"""A log as arrays, DataFrames, CSV and Parquet: the same values bit for bit, with units."""

import csv
import json
import math
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from pyarrow import parquet

from harness.log.channel import Channel
from harness.log.export import export
from harness.log.log import Log
from models.errors import UsageError

TRICKY = [0.1, -0.0, math.nan, math.inf, -math.inf, 5e-324]


def log() -> Log:
    """Six ticks of a plant whose speed takes every kind of value, and of a component called a/b."""
    channels = (
        Channel(
            "plant", "canine", ("command", "speed", "shaking"), ("", "m/s", ""),
            ("Integer", "Real", "Boolean"),
            ("what it is told", "ground speed, m/s", "is it shaking?"),
        ),
        Channel("a/b", "toy", ("time",), ("s",), ("Real",), ("of its own",)),
    )  # fmt: skip
    time = np.arange(6, dtype=np.float64) * 0.04
    plant = np.column_stack([[0, 1, 2, 3, 4, 5], TRICKY, [0, 1, 0, 1, 1, 0]]).astype(float)
    return Log(Path("trial.mcap"), channels, {}, {}, time, {"plant": plant, "a/b": time[:, None] + 7})


def same_bits(a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
    """Are two columns of reals the same, -0.0 apart from 0.0, every NaN alike?"""
    x, y = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    nan = np.isnan(x)
    return bool((nan == np.isnan(y)).all()) and x[~nan].tobytes() == y[~nan].tobytes()


def test_arrays_have_the_types_of_the_signals() -> None:
    plant = log().arrays()["plant"]
    assert [column.dtype.name for column in plant.values()] == ["int64", "float64", "bool"]
    assert plant["command"].tolist() == [0, 1, 2, 3, 4, 5]
    assert plant["shaking"].tolist() == [False, True, False, True, True, False]
    assert same_bits(plant["speed"], TRICKY)


@pytest.mark.parametrize(
    ("value", "dtype"),
    [(2.0**63, "float64"), (1.8e19, "float64"), (-(2.0**64), "float64"), (2.0**63 - 1024, "int64")],
)
def test_an_integer_that_int64_cannot_hold_stays_a_real(value: float, dtype: str, tmp_path: Path) -> None:
    # given FMI 3's UInt64 at and beyond 2^63, and the largest number below it
    count = Channel("plant", "toy", ("count",), ("",), ("Integer",), ("counts",))
    values = {"plant": np.array([[1.0], [value]])}
    large = Log(Path("trial.mcap"), (count,), {}, {}, np.array([0, 0.04]), values)
    # when
    column = large.arrays()["plant"]["count"]
    export(large, "csv", tmp_path)
    # then
    assert column.dtype.name == dtype
    assert column.tolist() == [1, value]
    assert float((tmp_path / "plant.csv").read_text().splitlines()[-1].split(",")[1]) == value


def test_an_array_that_is_changed_leaves_the_log_as_it_was() -> None:
    whole = log()
    whole.arrays()["plant"]["speed"][:] = 9.0
    assert same_bits(whole["plant.speed"], TRICKY)


def test_frames_are_indexed_by_time_and_know_their_units() -> None:
    frame = log().frames()["plant"]
    assert frame.index.name == "time"
    assert frame.index.tolist() == log().time.tolist()
    assert frame.attrs["units"] == {"command": "", "speed": "m/s", "shaking": ""}
    assert [str(kind) for kind in frame.dtypes] == ["int64", "float64", "bool"]
    assert same_bits(frame["speed"], TRICKY)


def test_csv_reads_back_to_the_same_bits(tmp_path: Path) -> None:
    # when
    paths = export(log(), "csv", tmp_path / "new")
    # then
    assert [path.name for path in paths] == ["plant.csv", "a%2Fb.csv", "units.json"]
    lines = paths[0].read_text().splitlines()
    assert lines[:5] == [
        "time,command,speed,shaking", "0.0,0,0.1,0", "0.04,1,-0.0,1", "0.08,2,NaN,0", "0.12,3,Infinity,1"
    ]  # fmt: skip
    rows = list(csv.DictReader(lines))
    assert same_bits([float(row["speed"]) for row in rows], TRICKY)
    frame = pd.read_csv(paths[0])
    assert same_bits(frame["speed"], TRICKY)
    assert same_bits(frame["time"], log().time)
    assert paths[1].read_text().splitlines()[:2] == ["time,a/b.time", "0.0,7.0"]


def test_parquet_reads_back_to_the_same_bits_with_units(tmp_path: Path) -> None:
    # when
    plant, *_ = export(log(), "parquet", tmp_path)
    # then
    table = parquet.read_table(plant)
    assert table.column_names == ["time", "command", "speed", "shaking"]
    assert [str(field.type) for field in table.schema] == ["double", "int64", "double", "bool"]
    assert same_bits(table["speed"].to_numpy(), TRICKY)
    assert table["speed"].null_count == 0
    assert table.schema.field("speed").metadata == {
        b"unit": b"m/s", b"type": b"Real", b"meaning": b"ground speed, m/s"
    }  # fmt: skip
    assert table.schema.field("time").metadata[b"unit"] == b"s"
    # and a component's own time does not take the place of the ticks'
    assert parquet.read_table(tmp_path / "a%2Fb.parquet").column_names == ["time", "a/b.time"]


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_units_lie_beside_in_both_formats(to: str, tmp_path: Path) -> None:
    units = json.loads(export(log(), to, tmp_path)[-1].read_text())
    assert units["plant"]["speed"] == {"unit": "m/s", "type": "Real", "meaning": "ground speed, m/s"}
    assert list(units) == ["plant", "a/b"]


@pytest.mark.parametrize(
    ("library", "error"),
    [
        ("pandas", r'which is not installed; pip install "guided-canine\[pandas\]", or take Log.arrays\(\)'),
        ("pyarrow", r'which is not installed; pip install "guided-canine\[parquet\]", or take --to csv'),
    ],
)
def test_a_library_that_is_not_installed_is_named_with_its_extra(
    library: str, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(UsageError, match=f"needs {library}, {error}"):
        log().frames() if library == "pandas" else export(log(), "parquet", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_format_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match='--to parket: expected one of csv, parquet; did you mean "parquet"'):
        export(log(), "parket", tmp_path)


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_an_export_of_another_log_leaves_none_of_the_first(to: str, tmp_path: Path) -> None:
    # given a log in both formats, and a file of the user's
    for each in ("csv", "parquet"):
        export(log(), each, tmp_path)
    (tmp_path / "mine.csv").write_text("0")
    assert len(list(tmp_path.iterdir())) == 2 + 2 + 1 + 1
    # when one with another component is exported there
    channel = Channel("toy", "toy", ("x",), ("m",), ("Real",), ("",))
    other = Log(Path("trial.mcap"), (channel,), {}, {}, log().time, {"toy": log().time[:, None]})
    export(other, to, tmp_path)
    # then
    assert {path.name for path in tmp_path.iterdir()} == {f"toy.{to}", "units.json", "mine.csv"}


@pytest.mark.parametrize("content", ["", "[1]", "{"])
def test_units_that_are_not_ours_are_replaced(content: str, tmp_path: Path) -> None:
    (tmp_path / "units.json").write_text(content)
    assert len(export(log(), "csv", tmp_path)) == len(list(tmp_path.iterdir())) == 3

"""Two logs compared: bits, tolerances, angles, rows and signals of one alone, what they state."""

import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from harness.log.channel import Channel
from harness.log.compare import LogComparison, RowsOfOne, Statement, Tolerances, compare
from harness.log.comparison_table import show
from harness.log.log import Log
from models.errors import UsageError

NAN, INF = math.nan, math.inf
UNITS = {"north": "m", "heading": "rad", "heading_sd": "rad", "course": "deg", "on": "", "mode": ""}
TYPES = {"on": "Boolean", "mode": "Integer"}


def log(
    signals: Mapping[str, Sequence[float]],
    *,
    times: Sequence[float] | None = None,
    broken: str = "",
    metadata: Mapping[str, dict[str, str]] | None = None,
) -> Log:
    """A log of an estimator with these signals, at 25 Hz."""
    count = len(next(iter(signals.values())))
    names = tuple(signals)
    channel = Channel(
        "estimator", "four_state", names, tuple(UNITS[name] for name in names),
        tuple(TYPES.get(name, "Real") for name in names), names,
    )  # fmt: skip
    time = np.array([k * 0.04 for k in range(count)] if times is None else times, dtype=np.float64)
    values = {"estimator": np.array([*signals.values()], dtype=float).T}
    return Log(Path("a.mcap"), (channel,), {**(metadata or {})}, {}, time, values, broken=broken)


def pair(a: float, b: float, tolerances: Tolerances | None = None, name: str = "north") -> LogComparison:
    """Two logs of one value."""
    return compare(log({name: [a]}), log({name: [b]}), tolerances)


def test_the_first_difference_is_that_of_the_earliest_tick_and_the_largest_is_measured() -> None:
    # given headings that differ from tick 3 on, and norths by 0.5 at tick 2 and by 2 at tick 4
    a = log({"heading": [0, 0, 0, 0, 0], "north": [1, 1, 1, 1, 1], "mode": [0, 0, 1, 1, 1]})
    b = log({"heading": [0, 0, 0, 0.1, 0.1], "north": [1, 1, 1.5, 1, -1], "mode": [0, 0, 2, 1, 1]})
    # when
    result = compare(a, b)
    # then the first one is north's, and mode differs on the same tick
    first = result.first
    assert first is not None
    assert (first.signal, first.tick, first.time_s) == ("estimator.north", 2, 0.08)
    assert (first.a, first.b, first.unit, first.signals) == (1.0, 1.5, "m", 2)
    # and each signal has its numbers: north is off by 0.5 and 2 in five rows, 0.5 on the mean
    heading, north, mode = result.signals
    assert (north.rows, north.max, north.tick, north.time_s, north.mean) == (2, 2.0, 4, 0.16, 0.5)
    assert (heading.rows, heading.max, heading.tick) == (2, 0.1, 3)
    assert heading.mean == pytest.approx(0.04)
    assert (mode.rows, mode.max, mode.tick, mode.not_finite) == (1, 1.0, 2, 0)
    assert not result.agree
    assert (result.rows, result.signals_compared, result.until_s) == (5, 3, 0.16)


@pytest.mark.parametrize(
    ("a", "b", "bits", "by_value"),
    [
        (1.0, 1.0, True, True),
        (NAN, NAN, True, True),
        (INF, INF, True, True),
        (0.0, -0.0, False, True),
        (1.0, math.nextafter(1.0, 2.0), False, False),
        (NAN, 1.0, False, False),
        (INF, 1.0, False, False),
        (INF, -INF, False, False),
    ],
)
def test_bits_and_a_tolerance_of_0_judge_special_values(
    a: float, b: float, bits: bool, by_value: bool
) -> None:
    for one, other in ((a, b), (b, a)):
        assert pair(one, other).agree == bits
        assert pair(one, other, Tolerances(0.0)).agree == by_value


def test_a_nan_of_other_bits_is_the_same_nan() -> None:
    negative = float(np.array([-1], dtype=np.int64).view(np.float64)[0])
    assert math.isnan(negative)
    assert pair(NAN, negative).agree


def test_no_tolerance_is_so_wide_that_nan_is_a_number() -> None:
    assert not pair(NAN, 1.0, Tolerances(INF)).agree
    assert pair(-INF, 1e300, Tolerances(INF)).agree


def test_rows_without_a_number_are_counted_beside_the_largest_difference() -> None:
    # given a NaN against a number, an infinity against a number, and a difference of 3
    result = compare(log({"north": [NAN, INF, 5.0, 1.0]}), log({"north": [0.0, 0.0, 2.0, 1.0]}))
    # then the mean is over the two rows in which both are numbers
    (north,) = result.signals
    assert (north.rows, north.not_finite, north.max, north.tick, north.mean) == (3, 2, 3.0, 2, 1.5)
    # and where no row has a difference that is a number, the first of them is named
    (north,) = compare(log({"north": [1.0, NAN]}), log({"north": [1.0, 0.0]})).signals
    assert (north.rows, north.not_finite, north.max, north.tick, north.mean) == (1, 1, None, 1, 0.0)


def test_rows_in_which_both_are_nan_or_the_same_infinity_do_not_lower_the_mean() -> None:
    result = compare(log({"north": [NAN, INF, -INF, 1, 3]}), log({"north": [NAN, INF, -INF, 1, 5]}))
    (north,) = result.signals
    assert (north.rows, north.not_finite, north.max, north.mean) == (1, 0, 2.0, 1.0)


def test_a_difference_of_finite_values_that_overflows_is_infinite_and_the_largest() -> None:
    result = compare(log({"north": [0, 1.7e308]}), log({"north": [2, -1.7e308]}))
    (north,) = result.signals
    assert (north.rows, north.not_finite, north.max, north.tick, north.mean) == (2, 0, INF, 1, INF)
    # and of angles it is the shorter way round: 3.4e308 modulo a turn, in whole numbers
    (course,) = pair(1.7e308, -1.7e308, name="course").signals
    beyond = 2 * int(1.7e308) % 360
    assert course.max == min(beyond, 360 - beyond)
    assert pair(1.7e308, -1.7e308, Tolerances(180), name="course").agree


@pytest.mark.parametrize(
    ("name", "a", "b", "expected"),
    [
        ("heading", math.pi, -math.pi, 0.0),
        ("heading", 3.0, -3.0, 2 * math.pi - 6),
        ("heading", 0.5, 0.25, 0.25),
        ("course", 359.0, 1.0, 2.0),
        ("course", -90.0, 90.0, 180.0),
        ("heading_sd", 500.0, 0.1, 499.9),
        ("north", 400.0, 0.0, 400.0),
    ],
)
def test_an_angle_differs_by_the_shorter_way_round_and_a_deviation_by_its_number(
    name: str, a: float, b: float, expected: float
) -> None:
    # given values of other bits, then the difference is
    (signal,) = pair(a, b, name=name).signals
    assert signal.max == pytest.approx(expected, abs=1e-12)
    # and a tolerance a little wider or tighter decides by it
    assert pair(a, b, Tolerances(expected + 1e-9), name).agree
    assert expected == 0 or not pair(a, b, Tolerances(expected - 1e-9), name).agree


@given(a=st.floats(-math.pi, math.pi), b=st.floats(-math.pi, math.pi))
def test_the_difference_of_angles_is_that_of_their_directions(a: float, b: float) -> None:
    # given the angle between two unit vectors
    expected = abs(math.atan2(math.sin(a - b), math.cos(a - b)))
    for signal in pair(a, b, name="heading").signals:
        assert signal.max == pytest.approx(expected, abs=1e-14)


def test_a_difference_of_exactly_the_tolerance_agrees() -> None:
    assert pair(1.0, 1.5, Tolerances(0.5)).agree
    assert not pair(1.0, 1.5, Tolerances(math.nextafter(0.5, 0))).agree


def test_the_tolerance_of_a_signal_goes_before_its_components_and_that_before_all() -> None:
    tolerances = Tolerances.parse(["0.1", "estimator=0.5", "estimator.north=2"])
    assert tolerances.of("estimator", "north") == 2
    assert tolerances.of("estimator", "east") == 0.5
    assert tolerances.of("plant", "north") == 0.1
    assert Tolerances.parse(["plant=1"]).of("estimator", "north") is None
    # and each holds
    a, b = log({"north": [0.0], "heading": [0.0]}), log({"north": [1.0], "heading": [1.0]})
    (signal,) = compare(a, b, Tolerances.parse(["estimator.north=1"])).signals
    assert (signal.signal, signal.tolerance) == ("estimator.heading", None)
    (signal,) = compare(a, b, Tolerances.parse(["estimator=1", "estimator.north=0.5"])).signals
    assert (signal.signal, signal.tolerance) == ("estimator.north", 0.5)


@pytest.mark.parametrize(
    ("texts", "error"),
    [
        (["-1"], "--tolerance -1.0: expected a number from 0 on, as in 1e-9 or estimator.north=0.01"),
        (["nan"], "--tolerance nan: expected a number from 0 on"),
        (["north"], "--tolerance north: expected a number from 0 on"),
        (["estimator.north="], "--tolerance estimator.north=: expected a number from 0 on"),
        (["estimator.north=x"], "--tolerance estimator.north=x: expected a number from 0 on"),
        (["1", "2"], "--tolerance 2: one for all signals is given already"),
        (["estimator=1", "estimator=2"], "--tolerance estimator=2: estimator is given already"),
        (["estimator.norht=1"], "--tolerance estimator.norht: neither log has such a signal; did you mean"),
    ],
)
def test_a_tolerance_that_cannot_hold_is_refused(texts: list[str], error: str) -> None:
    with pytest.raises(UsageError) as caught:
        compare(log({"north": [0.0]}), log({"north": [0.0]}), Tolerances.parse(texts))
    assert str(caught.value).startswith(error)


def test_a_tolerance_that_is_no_number_is_refused_from_python_too() -> None:
    with pytest.raises(UsageError, match=r"--tolerance estimator\.north=0\.1: expected a number"):
        Tolerances(own={"estimator.north": "0.1"})  # type: ignore[dict-item]


def test_rows_and_signals_of_one_log_are_told_and_count() -> None:
    # given 4 ticks and a mode against 2 ticks and a course
    a = log({"north": [0, 0, 0, 0], "mode": [0, 0, 0, 0]})
    b = log({"north": [0, 0], "course": [0, 0]})
    # when
    result = compare(a, b)
    # then
    assert result.rows_of_one == {"a": RowsOfOne(2, 0.08, 0.12), "b": None}
    assert result.signals_of_one == {"a": ["estimator.mode"], "b": ["estimator.course"]}
    assert (result.rows, result.signals_compared, result.agree) == (2, 1, False)
    assert compare(b, a).rows_of_one == {"a": None, "b": RowsOfOne(2, 0.08, 0.12)}
    # and each of both counts alone
    assert not compare(log({"north": [0, 0]}), log({"north": [0]})).agree
    assert not compare(log({"north": [0], "mode": [0]}), log({"north": [0]})).agree


def test_logs_of_other_steps_are_compared_where_both_have_a_tick() -> None:
    # given 25 Hz against 50 Hz, that differ at 0.08 s: tick 2 of A
    a = log({"north": [0, 1, 2]})
    b = log({"north": [0, 0.5, 1, 1.5, 7]}, times=[0, 0.02, 0.04, 0.06, 0.08])
    result = compare(a, b)
    assert result.rows == 3
    assert result.first is not None
    assert (result.first.tick, result.first.a, result.first.b) == (2, 2.0, 7.0)
    assert result.rows_of_one == {"a": None, "b": RowsOfOne(2, 0.02, 0.06)}


def test_logs_without_a_common_tick_differ() -> None:
    result = compare(log({"north": [0.0]}), log({"north": [0.0]}, times=[0.02]))
    assert (result.rows, result.until_s, result.agree) == (0, None, False)
    assert "differ: 0 of 1 signals differ in 0 rows\n" in printed(result)


def test_what_comes_after_a_cut_does_not_count_and_what_comes_before_does() -> None:
    whole, cut = log({"north": [0, 1, 2]}), log({"north": [0, 1]}, broken="the file ends early")
    for a, b in ((whole, cut), (cut, whole)):
        assert compare(a, b).agree
    assert compare(whole, cut).broken == {"a": "", "b": "the file ends early"}
    # but one that is whole has no ticks to come, a row before the cut is a row, and a value a value
    assert not compare(replace(whole, broken="cut"), replace(cut, broken="")).agree
    assert not compare(whole, log({"north": [0, 2]}, times=[0, 0.08], broken="cut")).agree
    assert not compare(whole, log({"north": [0, 9]}, broken="cut")).agree


SCENARIO = {"name": "leg", "seed": "1", "toml": 'seed = 1\nwaypoints = [[1.0, 2.0]]\n"x"."y.z" = 3\n'}


def stating(**records: dict[str, str]) -> Log:
    return log({"north": [0.0]}, metadata=records)


def test_scenario_parameters_versions_files_and_origin_are_told_name_by_name() -> None:
    # given
    a = stating(
        scenario=SCENARIO, parameters={"plant.drift": "1.0", "plant.speed": "2.0"}, versions={"numpy": "2.0"}
    )
    b = stating(
        scenario={**SCENARIO, "toml": SCENARIO["toml"].replace("2.0", "2.5").replace("seed = 1", "seed = 7")},
        parameters={"plant.drift": "1.5", "plant.speed": "2.0"}, versions={"numpy": "2.1", "fmpy": "0.3"},
    )  # fmt: skip
    a.attachments |= {"full.ssp": b"PK", "plant.fmu": b"same"}
    b.attachments |= {"full.ssp": b"PKK", "plant.fmu": b"same", "dog.fmu": b""}
    b.origin = (32.6, 0.0)
    # then; the checksums are gzip's of the same bytes
    assert compare(a, b).statements == [
        Statement("scenario.seed", 1, 7),
        Statement("scenario.waypoints", [[1.0, 2.0]], [[1.0, 2.5]]),
        Statement("parameters.plant.drift", "1.0", "1.5"),
        Statement("versions.numpy", "2.0", "2.1"),
        Statement("versions.fmpy", None, "0.3"),
        Statement("origin", [0.0, 0.0], [32.6, 0.0]),
        Statement("file full.ssp", "2 bytes, CRC-32 1a6cd7b3", "3 bytes, CRC-32 617ef974"),
        Statement("file dog.fmu", None, "0 bytes, CRC-32 00000000"),
    ]
    assert not compare(a, b).agree
    assert compare(a, b, values_only=True).agree
    assert compare(a, a).statements == []


def test_a_scenario_that_cannot_be_read_is_told_as_its_text() -> None:
    a, b = stating(scenario=SCENARIO), stating(scenario={**SCENARIO, "toml": "seed ="})
    assert compare(a, b).statements == [Statement("scenario.toml", SCENARIO["toml"], "seed =")]


def test_a_unit_or_a_type_that_differs_is_told() -> None:
    a, b = log({"north": [1.0]}), log({"north": [1.0]})
    (channel,) = b.channels
    b.channels = (replace(channel, units=("ft",), types=("Integer",)),)
    assert compare(a, b).statements == [
        Statement("estimator.north: unit", "m", "ft"),
        Statement("estimator.north: type", "Real", "Integer"),
    ]
    assert not compare(a, b).agree


def printed(comparison: LogComparison) -> str:
    text = io.StringIO()
    show(comparison, Console(file=text, width=200))
    return text.getvalue()


def test_what_is_printed_begins_with_the_first_difference_and_ends_with_the_verdict() -> None:
    a = log({"on": [0, 1], "north": [0.1, 0.2], "mode": [1, 1]}, metadata={"versions": {"numpy": "[b]2"}})
    b = log({"on": [0, 0], "north": [0.1, NAN]})
    lines = [" ".join(line.split()) for line in printed(compare(a, b)).splitlines()]
    assert lines == [
        "first difference: tick 1, 0.04 s, estimator.on, and 1 more signal",
        "A True",
        "B False",
        "signals that only A has: estimator.mode",
        "signal unit rows not finite largest at tick at s mean tolerance",
        "estimator.on 1 1 1 0.04 0.5 bits",
        "estimator.north m 1 1 1 0.04 0 bits",
        "stated differently A B",
        "versions.numpy [b]2 none",
        "a.mcap and a.mcap differ: 2 of 2 signals differ in 2 rows up to 0.04 s",
    ]


def test_logs_that_are_only_stated_differently_are_told_how_to_compare_their_rows() -> None:
    logs = log({"north": [0.1]}, metadata={"versions": {"numpy": "2"}}), log({"north": [0.1]})
    assert printed(compare(*logs)).endswith(
        "differ: 0 of 1 signals differ in 1 rows up to 0 s; --values-only compares the rows alone\n"
    )
    assert printed(compare(*logs, values_only=True)).endswith(
        "agree: 0 of 1 signals differ in 1 rows up to 0 s\n"
    )


def test_the_facts_are_json_without_nan() -> None:
    result = compare(log({"north": [NAN], "mode": [1]}), log({"north": [-INF], "mode": [2]}), Tolerances(INF))
    facts = json.loads(json.dumps(result.facts(), allow_nan=False))
    assert (facts["agree"], facts["first"]["a"], facts["first"]["b"]) == (False, "NaN", "-Infinity")
    assert facts["signals"] == [
        {
            "signal": "estimator.north", "unit": "m", "tolerance": "Infinity", "rows": 1, "not_finite": 1,
            "max": None, "tick": 0, "time_s": 0.0, "mean": None,
        }
    ]  # fmt: skip

"""TOML from elsewhere: read as Python's parser reads it, or refused in one line, in bounded time."""

import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from harness.cosim.roles import RoleError, find_role, read_adapter
from harness.toml_file import MAX_BYTES, TomlError, parse_toml, read_toml
from harness.trial.scenario import SHIPPED, Scenario, load
from models.errors import CanineError
from tests.memory import PRINT_PEAK

GOOD = (SHIPPED / "three_waypoint.toml").read_bytes()
MAPPING = b'[outputs]\nnorth = "x[1]"\nheading = { name = "psi", factor = 0.0174, offset = 1.0 }\n'
MANY = 50_000


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("seed = 1\n" + "a" + ".a" * MANY + " = 1", "line 2: a name has more than 8 levels"),
        ("a" + " . a" * MANY + " = 1", "line 1: a name has more than 8 levels"),
        ('""' + '."a"' * MANY + " = 1", "line 1: a name has more than 8 levels"),
        ("\n\n[a" + ".a" * MANY + "]", "line 3: a name has more than 8 levels"),
        ("a = [\n" + "[" * MANY, "line 2: brackets are nested 17 deep; at most 16 are read"),
        ("a = " + "{a=" * MANY, "line 1: brackets are nested 17 deep; at most 16 are read"),
        ("a = " + "1" * 100_000, 'line 1: "11111111111111111111..." has 100000 characters; outside quotes'),
        ("a = 1_" + "0" * 5000, 'line 1: "1_000000000000000000..." has 5002 characters; outside quotes'),
        ("a" * 1001 + " = 1", 'line 1: "aaaaaaaaaaaaaaaaaaaa..." has 1001 characters; outside quotes'),
        ("#" * MAX_BYTES + "\n", "has more than 524288 characters; is it the right file?"),
        ("a = 1 = 2", "line 1 is `a = 1 = 2` (Expected newline or end of document after a statement)"),
        ('"a\nb" = 1', "line 1 is `\"a` (Illegal character '\\n'); expected a quote"),
        ("a = 2020-02-31", "line 1 is `a = 2020-02-31` ("),
        ('a = "\\UFFFFFFFF"', "Escaped character is not a Unicode scalar value"),
    ],
)
def test_what_no_file_of_ours_needs_is_refused_with_its_line(text: str, expected: str) -> None:
    started = time.process_time()
    with pytest.raises(TomlError) as caught:
        parse_toml(text)
    assert time.process_time() - started < 5
    assert expected in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "text",
    [
        "a.b.c.d.e.f.g.h = 1",
        "a = [[[[[[[[[[[[[[[[1.5, 2.5]]]]]]]]]]]]]]]]",
        "a = [1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5, 10.5]",
        f'a = "{"x." * 1000}[[[[[[[[[[[[[[[[[[[[" # {"." * 1000}[[[[[[[[[[[[[[[[[[[[',
        f"a = '''\n{'[' * 1000}'' {'.' * 1000}'''",
        f'a = """{"[" * 1000}\\""" {"." * 1000}"""""',
        "a = '\\'\nb = '[[[[[[[[[[[[[[[[[[[['",
        "a = " + "1" * 1000,
        "'" + "a" * 1000 + "' = 1",
        "[[a]]\n" * 1000,
    ],
)
def test_what_is_within_the_limits_is_read_as_pythons_parser_reads_it(text: str) -> None:
    assert parse_toml(text) == tomllib.loads(text)


@pytest.mark.parametrize(
    "data", [b"\xef\xbb\xbf" + GOOD, GOOD.replace(b"\n", b"\r\n"), GOOD.replace(b"\n", b"\r")]
)
def test_a_byte_order_mark_and_other_ends_of_lines_change_nothing(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "three_waypoint.toml"
    path.write_bytes(GOOD)
    expected = load(str(path))
    path.write_bytes(data)
    assert load(str(path)) == expected


def test_a_file_that_is_not_utf8_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b"seed = 1\nname = 'Z\xfcrich'\n")
    with pytest.raises(TomlError, match=r"^line 2: byte 0xfc is not UTF-8; save the file as UTF-8$"):
        read_toml(path)


def test_a_file_that_is_too_large_is_not_read_to_its_end(tmp_path: Path) -> None:
    # given a file of 1 TiB, most of it a hole
    path = tmp_path / "a.toml"
    with path.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(TomlError, match=r"^has more than 524288 bytes; is it the right file\?"):
        read_toml(path)


@pytest.mark.parametrize("name", ["scenario", "mapping"])
def test_scenarios_and_mapping_files_have_the_limits(name: str, tmp_path: Path) -> None:
    path = tmp_path / "dog.toml"
    path.write_text("a" + ".a" * MANY + " = 1")
    with pytest.raises(CanineError, match=r"dog\.toml: line 1: a name has more than 8 levels"):
        load(str(path)) if name == "scenario" else read_adapter(tmp_path / "dog.fmu", find_role("plant"))


def test_settings_have_the_limits_too() -> None:
    # a value that cannot be TOML is taken as a name, and a name is refused where it is used
    scenario = Scenario("dog").override([f"plant.u={'[' * MANY}"])
    assert scenario.parameters["plant.u"] == "[" * MANY


TEXT = st.text("a.[]{}='\"\\#\n\r,1_ \x00é\u202e", max_size=60)


@settings(max_examples=100, deadline=None)
@given(text=TEXT)
def test_any_text_is_read_as_pythons_parser_reads_it_or_refused(text: str) -> None:
    assume(text.count(".") < 8 and max(map(text.count, "[{")) < 8)
    try:
        expected = tomllib.loads(text)
    except ValueError:
        with pytest.raises(TomlError):
            parse_toml(text)
        return
    assert parse_toml(text) == expected


@settings(max_examples=100, deadline=None)
@given(data=st.data(), good=st.sampled_from([GOOD, MAPPING]))
def test_damaged_scenarios_and_mapping_files_raise_nothing_but_errors_of_ours(
    data: st.DataObject, good: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    # given a good file with bytes cut out, put in or overwritten
    damaged = bytearray(good)
    for _ in range(data.draw(st.integers(1, 3))):
        at, length = data.draw(st.integers(0, len(good))), data.draw(st.integers(0, 20))
        damaged[at : at + length] = data.draw(st.binary(max_size=6) | TEXT.map(str.encode))
    path = tmp_path_factory.mktemp("fuzz") / "dog.toml"
    path.write_bytes(damaged)
    # when it is read as what it is
    try:
        load(str(path)) if good is GOOD else read_adapter(path.with_suffix(".fmu"), find_role("plant"))
    except CanineError as error:
        # then the message is one line that names the file
        assert str(error).isprintable()  # noqa: PT017
        assert "dog.toml: " in str(error)  # noqa: PT017


def test_the_worst_text_within_the_limits_is_read_in_seconds() -> None:
    # given texts as large as is read, of what costs Python's parser the most, in a process of their own
    code = (
        "from harness.toml_file import MAX_BYTES, parse_toml\n"
        "texts = ['[[a]]\\n' * (MAX_BYTES // 6), 'a=[' + '1,' * (MAX_BYTES // 2 - 3) + ']']\n"
        "texts += ['a=[' + '{b=[{c=[{d=1}]}]},' * (MAX_BYTES // 19) + ']']\n"
        "texts += ['a=' + ' ' * (MAX_BYTES - 9) + '1']\n"
        "texts += ['\\n'.join(f'[a.b.c.d.e.f{i}]' for i in range(MAX_BYTES // 19))]\n"
        "for text in texts: parse_toml(text)\n"
        f"{PRINT_PEAK}"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, text=True, timeout=120,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    # then they cost less than 400 MiB
    assert int(done.stdout) < 400


def test_a_mapping_file_that_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "dog.toml"
    path.write_bytes(b"\xff")
    with pytest.raises(RoleError, match=r"^dog\.toml: line 1: byte 0xff is not UTF-8"):
        read_adapter(tmp_path / "dog.fmu", find_role("plant"))

"""The radio's key: its file, the bundle that has it, and the one that has none (rule 11)."""

from __future__ import annotations

import hashlib
import re
import stat
from pathlib import Path

import pytest

from codegen.firmware.bundle import KEY_FILE, bundle, library
from codegen.firmware.key import SIMULATION_KEY, Key, read, write_new
from codegen.firmware.targets import TARGETS
from codegen.toolchains.compiler import build_library
from harness import main
from models.errors import UsageError

KEY = "8f1c2b3a4d5e6f708192a3b4c5d6e7f8"
NAMES = ("--key", "--insecure", "keygen")


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file with KEY."""
    path = tmp_path / "a.key"
    path.write_text(f"# a vest's\n\n{KEY}\n")
    path.chmod(0o600)
    return path


def test_keygen_writes_a_new_key_that_its_owner_alone_may_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keys = set()
    for name in ("a.key", "b.key"):
        assert main.run(["keygen", "--out", str(tmp_path / name)]) == 0
        comment, digits = (tmp_path / name).read_text().splitlines()
        # then it is 32 digits behind a comment that says what it is
        assert comment.startswith("# ")
        assert "SECRET" in comment
        assert re.fullmatch("[0-9a-f]{32}", digits)
        assert mode(tmp_path / name) == 0o600
        assert read(tmp_path / name) == Key(bytes.fromhex(digits))
        keys.add(digits)
        # and is not shown
        assert digits not in "".join(capsys.readouterr())
    assert len(keys) == 2


def test_keygen_overwrites_no_file(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = file.read_bytes()
    assert main.run(["keygen", "--out", str(file)]) == 2
    assert "not overwritten" in capsys.readouterr().err
    assert file.read_bytes() == before
    with pytest.raises(UsageError, match="cannot be written"):
        write_new(file / "x")


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o622, 0o666, 0o777])
def test_a_file_that_others_may_change_is_refused(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], mode: int
) -> None:
    file.chmod(mode)
    arguments = ["--target", "host", "--key", str(file), "--out", str(tmp_path / "fw")]
    assert main.run(["firmware", *arguments]) == 2
    # then the error tells the file, its mode, the mode that it should have, and what to do
    error = "".join(capsys.readouterr())
    for part in (f"--key {file}: ", f" {mode:04o}", " 0600", f"chmod 600 {file}", "`canine keygen`"):
        assert part in " ".join(error.split())
    assert KEY not in error
    assert not (tmp_path / "fw").exists()


@pytest.mark.parametrize(
    ("mode", "noted"),
    [(0o600, False), (0o400, False), (0o711, False), (0o640, True), (0o604, True), (0o444, True)],
)
def test_a_file_that_others_may_read_is_taken_with_a_note(file: Path, mode: int, noted: bool) -> None:
    file.chmod(mode)
    notes = list[str]()
    assert read(file, notes.append) == Key(bytes.fromhex(KEY))
    # then the note tells the file, its mode and what to do
    assert len(notes) == noted
    for part in (f"--key {file}: ", f" {mode:04o}", f"chmod 600 {file}", "`canine keygen`"):
        assert all(part in note and KEY not in note for note in notes)


def test_firmware_prints_the_note_on_a_key_that_others_may_read(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["firmware", "--target", "host", "--key", str(file), "--out", str(tmp_path / "fw")]
    for mode in (0o600, 0o644):
        file.chmod(mode)
        assert main.run(arguments) == 0
        assert (f"note: --key {file}: " in capsys.readouterr().err) is (mode == 0o644)


@pytest.mark.parametrize("text", ["", "# nothing", KEY[:-1], KEY + "0", f"{KEY}\n{KEY}", "x" * 32, "ä" * 32])
def test_a_file_without_a_key_is_refused(file: Path, tmp_path: Path, text: str) -> None:
    file.write_text(text)
    with pytest.raises(UsageError, match=r"--key .*a\.key: (cannot be read|expected one line)"):
        read(file)
    with pytest.raises(UsageError, match="cannot be read"):
        read(tmp_path / "none.key")


@pytest.mark.parametrize("digits", [SIMULATION_KEY.data.hex(), "00" * 16, "ff" * 16])
def test_a_key_that_everybody_knows_is_refused(file: Path, digits: str) -> None:
    file.write_text(digits)
    with pytest.raises(UsageError, match="everybody knows"):
        read(file)


def test_a_key_has_16_bytes_and_is_not_shown() -> None:
    with pytest.raises(UsageError, match="16 bytes, got 15"):
        Key(bytes(15))
    assert KEY not in repr(Key(bytes.fromhex(KEY)))
    assert repr(bytes.fromhex(KEY)) not in repr(Key(bytes.fromhex(KEY)))


@pytest.mark.parametrize("both", [False, True])
def test_firmware_needs_a_key_or_says_that_it_has_none(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], both: bool
) -> None:
    options = ["--key", str(file), "--insecure"] if both else []
    status = main.run(["firmware", "--target", "host", "--out", str(tmp_path / "fw"), *options])
    assert status == 2
    error = capsys.readouterr().err
    assert all(name in error for name in NAMES)
    assert not (tmp_path / "fw").exists()


def test_a_bundle_has_its_key_in_one_file_that_its_owner_alone_may_read(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "fw"
    arguments = ["firmware", "--target", "host", "--key", str(file), "--out", str(folder)]
    for _ in range(2):  # the same again takes its place
        assert main.run(arguments) == 0
    data = bytes.fromhex(KEY)
    text = (folder / KEY_FILE).read_text()
    assert bytes(int(byte, 16) for byte in re.findall("0x([0-9A-F]{2})U", text)) == data
    assert "SECRET" in text
    assert mode(folder / KEY_FILE) == 0o600
    # then no other file and nothing printed has it, and its sum is listed
    shown = "".join(capsys.readouterr())
    others = [path.read_text() for path in folder.iterdir() if path.name != KEY_FILE]
    for digits in (KEY, KEY.upper(), ", ".join(f"0x{x:02X}U" for x in data[:8])):
        assert not any(digits in other for other in (*others, shown))
    assert hashlib.sha256(text.encode()).hexdigest() in (folder / "SHA256SUMS").read_text()
    assert "#define KEY_SIGNS 1" in (folder / "key.h").read_text()
    assert "can command the vest" in (folder / "README.md").read_text()


def test_a_bundle_without_a_key_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "fw"
    assert main.run(["firmware", "--target", "host", "--insecure", "--out", str(folder)]) == 0
    assert "INSECURE" in "".join(capsys.readouterr())
    assert not (folder / KEY_FILE).exists()
    assert "#define KEY_SIGNS 0" in (folder / "key.h").read_text()
    assert "INSECURE" in (folder / "README.md").read_text()


@pytest.mark.parametrize("constants", [[], ["--constants"]], ids=["fields", "constants"])
@pytest.mark.parametrize(
    ("reading", "limits"), [('reading = "calibrated"', False), ('reading = "guarded"', True), ("", True)]
)
def test_a_bundle_of_a_reading_without_limits_says_so(
    constants: list[str], reading: str, limits: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "my.toml"
    scenario.write_text(f"{reading}\n")
    options = ["--target", "host", "--insecure", "--out", str(tmp_path / "fw"), *constants]
    assert main.run(["firmware", *options, "--parameters", str(scenario)]) == 0
    assert ("WITHOUT LIMITS" in "".join(capsys.readouterr())) is not limits
    # and so do its README, at the top, and the comment of its parameters
    readme, parameters, header = (
        (tmp_path / "fw" / name).read_text() for name in ("README.md", "parameters.c", "cmec.h")
    )
    assert readme.split("\n\n")[1].startswith("**WITHOUT LIMITS: not for an animal.**") is not limits
    assert ("WITHOUT LIMITS" in parameters) is not limits
    stated = (
        f"#define CMEC_GUARDED {str(limits).lower()}" if constants else f"guarded = {str(limits).lower()}"
    )
    assert stated in (header if constants else parameters)
    # and what no limit does is no answer to a failure
    for failure in ("a limit of the safety rules is reached", "courses contradict the heading"):
        assert (f"| {failure} |" in readme) is limits


@pytest.mark.parametrize(
    ("mission", "what"),
    [
        ("waypoints = [[20, 0]]", "waypoints are not built in; the operator's MISSION sends them"),
        (
            "waypoints = [[20, 0]]\nfence = [[-9, -9], [30, -9], [30, 9]]",
            "waypoints and fence are not built in; the operator's MISSION sends them",
        ),
        (
            '[[fault]]\nsignal = "radio"\nkind = "lost"\nat = 1',
            "its [[fault]] are not built in; a trial has them, `canine run --onboard`",
        ),
        (
            '[parameters]\n"canine_in_streets.drift" = 2\n[[pole]]\nat = [9, 9]\n'
            "[[street]]\nfrom = [0, 0]\nto = [9, 0]\nhalf_width = 1",
            "its [[street]] and [[pole]] are not built in: they are the simulated dog's world, of which the "
            "vest knows nothing; a trial has them, `canine run --onboard`",
        ),
        ("", None),
    ],
)
def test_what_of_a_scenario_is_not_built_in_is_noted(
    mission: str, what: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a scenario with a mission, with a fault, with a street, or with none of them
    scenario = tmp_path / "park.toml"
    scenario.write_text(f"{mission}\n")
    # when its parameters are built in
    options = ["--target", "host", "--insecure", "--out", str(tmp_path / "fw")]
    assert main.run(["firmware", *options, "--parameters", str(scenario)]) == 0
    # then a note says what is not
    notes = [line for line in capsys.readouterr().err.splitlines() if "built in" in line]
    assert notes == ([f"note: {scenario}: {what}"] if what else [])


def test_the_default_bundle_has_the_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["firmware", "--target", "host", "--insecure", "--out", str(tmp_path / "fw")]) == 0
    assert "WITHOUT LIMITS" not in "".join(capsys.readouterr())


@pytest.mark.parametrize("key", [Key(bytes.fromhex(KEY)), None], ids=["key", "insecure"])
def test_the_program_compiles_with_a_key_and_without(key: Key | None, tmp_path: Path) -> None:
    files = library(key=key) | {"port.c": bundle(TARGETS["host"])["port.c"]}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    flags = (
        "-std=c99",
        "-O2",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Wshadow",
        "-Werror",
        "-I.",
    )
    sources = sorted(name for name in files if name.endswith(".c"))
    assert build_library(tmp_path, sources, tmp_path / "onboard.so", what="onboard", flags=flags).exists()


def test_simulated_vests_have_a_key_that_says_so() -> None:
    text = library()[KEY_FILE]
    assert "known to everybody: never for a vest" in text
    assert "SECRET" not in text

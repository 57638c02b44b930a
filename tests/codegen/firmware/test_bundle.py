"""The bundles: they build with their own Makefiles, call nothing that they should not, and run."""

from __future__ import annotations

import ctypes
import datetime
import graphlib
import hashlib
import json
import math
import os
import pty
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from elftools.elf.elffile import ELFFile

import codegen
from codegen.blocks.block_c import comment
from codegen.firmware import bundle
from codegen.firmware.bundle import BLOCKS, SOURCES
from codegen.firmware.image import Image
from codegen.firmware.key import SIMULATION_KEY
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.rabbit4000 import read_map
from codegen.firmware.record import is_mission
from codegen.firmware.targets import TARGETS
from codegen.firmware.telemetry import Flag, Refusal
from codegen.toolchains import sdcc
from codegen.toolchains.compiler import FLAGS, CompileError, build_library
from harness import main
from harness.log.geodesy import TangentPlane
from harness.onboard.instruments import InertialUnit, Receiver
from harness.onboard.processors import Received, open_processor
from harness.onboard.processors.rabbit4000 import BREAKPOINT, NOTHING, STOPPED, Console
from harness.onboard.radio import Decoder, Mission, Position, Seal, Start
from models.canine_ahrs import CanineAhrs
from models.canine_tracker import CanineTracker
from models.errors import UsageError
from models.four_state import FourState
from tests.codegen.compiled import struct_members
from tests.codegen.firmware.vest import LATITUDE, LONGITUDE, check_telemetry, lead_until_forward, still
from tests.harness.onboard.frames import answering, encode

PROJECT = Path(codegen.__file__).resolve().parents[1]
PROGRAM = {
    "host": "onboard",
    "cortex-m4f": "onboard.elf",
    "rabbit4000": "onboard.ihx",
    "stm32f405": "onboard.elf",
}
ARM = ("cortex-m4f", "stm32f405")
ZIG = [f"CC={sys.executable} -m ziglang cc", "CFLAGS=-fno-sanitize=all"]
ZIG_CPU = "CPU=-target thumb-freestanding-eabihf -mcpu=cortex_m4+vfp4d16sp"
FORBIDDEN = re.compile(
    r"_*(malloc|calloc|realloc|free|alloca|sbrk|(sin|cos|tan|atan2?|log|exp|pow|fmod)[fl]?)$"
)
DOUBLE = re.compile(r"__aeabi_(d|f2d|i2d|ui2d|l2d|ul2d|cd)|__\w+df\w*$|__extendsf|__truncdf|___ds|___fs2d")
FRAME = 26 * 4 + 4  # bytes that an exception puts on the stack, FPU registers included, and what aligns it
Make = Callable[..., Path]
write = partial(bundle.write, key=SIMULATION_KEY)


def tool(name: str, package: str) -> str:
    """A program of the system; tests that need it are left out without it, but not in CI."""
    path = shutil.which(name)
    if path is None:
        if os.environ.get("CI") == "true":
            pytest.fail(f"{name} is missing: apt install {package}")
        pytest.skip(f"{name} is missing: apt install {package}")
    return path


def rabbit_tools() -> list[str]:
    """Variables of the Rabbit's Makefile."""
    try:
        place = sdcc.home() / "bin"
    except CompileError as missing:
        if os.environ.get("CI") == "true":
            raise
        pytest.skip(f"sdcc 4.5 (packages sdcc, sdcc-libraries): {missing}")
    return [f"SDCC={place / 'sdcc'}", f"SDAS={place / 'sdasrab'}", f"PATH={place}:{os.environ['PATH']}"]


def variables(target: str) -> list[str]:
    """The arguments of make for a target on this machine."""
    if target == "rabbit4000":
        return rabbit_tools()
    if target == "host":
        tool("cc", "gcc")
        return []
    return [] if shutil.which("arm-none-eabi-gcc") else [*ZIG, ZIG_CPU]


def run_make(folder: Path, *settings: str) -> str:
    tool("make", "make")
    done = subprocess.run(
        ["make", "-s", "-j2", *settings], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """`made(target, constants=False)`: the folder of the bundle, built; each once."""
    folders: dict[tuple[str, bool], Path] = {}

    def make(target: str, constants: bool = False) -> Path:
        if (target, constants) not in folders:
            settings = variables(target)
            folder = tmp_path_factory.mktemp(target)
            write(TARGETS[target], folder, constants=constants)
            run_make(folder, *settings)
            folders[target, constants] = folder
        return folders[target, constants]

    return make


def canine(capsys: Any, *arguments: object) -> tuple[int, str]:
    """Exit status and standard error of the command."""
    status = main.run([str(argument) for argument in arguments])
    return status, capsys.readouterr().err


# --- it builds ---


@pytest.mark.parametrize("constants", [False, True], ids=["fields", "constants"])
@pytest.mark.parametrize("target", TARGETS)
def test_a_bundle_builds_with_its_own_makefile_and_is_small_enough(
    target: str, constants: bool, made: Make
) -> None:
    # given a bundle in a folder of its own, when `make` is called (warnings are errors)
    folder = made(target, constants)

    # then there is the program, and it fits
    assert (folder / PROGRAM[target]).stat().st_size > 0
    if target in ARM:
        code, data, bss = elf_sizes(folder / PROGRAM[target])
        assert code + data <= TARGETS[target].code
        assert bss <= TARGETS[target].ram
    if target == "rabbit4000":
        areas = map_areas(folder)
        flash = ("_CODE", "_HOME", "_BANK0", "_BANK1", "_CONST")
        assert 0x80 + sum(areas.get(area, 0) for area in flash) <= TARGETS[target].code
        assert areas["_DATA"] <= TARGETS[target].ram


def elf_sizes(path: Path) -> tuple[int, int, int]:
    with path.open("rb") as file:
        elf: Any = ELFFile(file)
        size = {s.name: s["sh_size"] for s in elf.iter_sections()}
        return size[".vectors"] + size[".text"] + size.get(".rodata", 0), size.get(".data", 0), size[".bss"]


def map_areas(folder: Path) -> dict[str, int]:
    rows = re.finditer(r"^(_\w+) +[0-9A-F]+ +([0-9A-F]+) =", (folder / "onboard.map").read_text(), re.M)
    return {m[1]: int(m[2], 16) for m in rows}


@pytest.mark.parametrize("target", ARM)
def test_the_bundles_for_arm_build_with_zig_too(target: str, tmp_path: Path) -> None:
    # given the bundle, when it is made with pip's compiler
    write(TARGETS[target], tmp_path)
    run_make(tmp_path, *ZIG, ZIG_CPU)

    # then there is the program
    assert elf_sizes(tmp_path / "onboard.elf")[0] > 10_000


@pytest.mark.parametrize("target", TARGETS)
def test_what_is_built_with_a_key_is_its_owners_alone_to_read(
    target: str, made: Make, tmp_path: Path
) -> None:
    # given a bundle with a key that was built before, and objects of the key that everybody may read
    settings = variables(target)
    for path in made(target).iterdir():
        shutil.copy2(path, tmp_path)
    (tmp_path / PROGRAM[target]).unlink()
    sources = bundle.bundle(TARGETS[target]).keys() | {bundle.SUMS}
    for path in tmp_path.glob("key.*"):
        if path.name not in sources:
            path.chmod(0o644)
    (tmp_path / bundle.KEY_FILE).touch()

    # when it is made by a user whose new files everybody may read
    mask = os.umask(0o022)
    try:
        run_make(tmp_path, *settings)
    finally:
        os.umask(mask)

    # then nobody else may read what was made, and the sources are as before
    made_files = [path for path in tmp_path.iterdir() if path.name not in sources]
    assert {PROGRAM[target], "key.rel" if target == "rabbit4000" else "key.o"} <= {p.name for p in made_files}
    assert [path.name for path in made_files if path.stat().st_mode & 0o077] == []


def test_what_a_constant_decides_builds_for_the_rabbit(tmp_path: Path) -> None:
    # given an AHRS whose magnetometer is switched off by a constant
    settings = rabbit_tools()
    write(TARGETS["rabbit4000"], tmp_path, {}, Navigation(FourState, CanineAhrs), constants=True)

    # when it is made, then that a condition never holds is no error
    run_make(tmp_path, *settings, "canine_ahrs.rel")
    assert (tmp_path / "canine_ahrs.rel").stat().st_size > 0


def _space(count: int) -> str:
    """C that takes some bytes of code."""
    return f"\nvoid filler(void) __naked {{ __asm .ds {count} __endasm; }}\n"


PARTS = {  # of the Rabbit's memory: a file that adds to it, its areas, where it ends, and what is said beyond
    "rest": ("parameters", ("_BANK0", "_CODE", "_HOME", "_CONST"), 0xE000, "code and constants reach into"),
    "resident": ("port", ("_CODE", "_HOME"), 0x6000, "CODE reaches into the banks"),
    "bank": (DEFAULT.name, ("_BANK1",), 0x8000, "the estimator is too large for its bank"),
}


@pytest.mark.parametrize("part", PARTS)
def test_an_image_for_the_rabbit_that_has_no_room_is_refused(part: str, tmp_path: Path, made: Make) -> None:
    # given the bundle's objects, and a file that fills what is left of its part of the memory
    file, areas, room, message = PARTS[part]
    settings = rabbit_tools()
    for path in made("rabbit4000").iterdir():
        shutil.copy2(path, tmp_path)
    sizes = map_areas(tmp_path)
    left = room - sum(sizes.get(area, 0) for area in areas)
    source = tmp_path / f"{file}.c"
    source.write_text(source.read_text() + _space(left + 1))

    # when it is made
    done = subprocess.run(
        ["make", "-s", *settings], cwd=tmp_path, capture_output=True, text=True, check=False
    )

    # then it says so, and leaves none
    assert done.returncode != 0
    assert message in done.stdout
    assert not (tmp_path / "onboard.ihx").exists()


def test_what_the_rabbits_estimator_calls_is_never_switched_out(made: Make) -> None:
    # given the symbols that its object needs, and where the linker laid them
    folder = made("rabbit4000")
    needed = set(re.findall(r"^S (\w+) Ref", (folder / f"{DEFAULT.name}.rel").read_text(), re.M))
    symbols = re.findall(r"^ +([0-9A-F]{8}) +(_\w+)", (folder / "onboard.map").read_text(), re.M)
    places = {name: int(at, 16) for at, name in symbols}

    # then they lie below the banks, or in the RAM; so do the handlers of interrupts
    assert {"_vest", "___fsmul"} <= needed
    handlers = {name for name in places if name.endswith("_interrupt")}
    assert len(handlers) == 3
    between = {n for n in needed | handlers if n in places and 0x6000 <= places[n] < 0xE000}
    assert between == set()
    # and the estimator itself lies in its bank
    assert places[f"_banked_{DEFAULT.name}_step"] >= 0x16000


# --- calls ---


def symbols(path: Path, *options: str) -> set[str]:
    listed = subprocess.run(
        [tool("nm", "binutils"), *options, path], capture_output=True, text=True, check=True
    ).stdout
    return {line.split()[-1] for line in listed.splitlines() if line.strip()}


def test_the_program_on_the_host_needs_nothing_but_copies_and_square_roots(made: Make) -> None:
    # given all objects except the port's, which calls POSIX
    objects = [path for path in made("host").glob("*.o") if path.stem != "port"]

    # when their undefined symbols are taken together
    undefined = set.union(*(symbols(path, "-u") for path in objects))
    defined = set.union(*(symbols(path, "--defined-only") for path in made("host").glob("*.o")))

    # then these remain at most, as the compiler inlines some
    assert undefined - defined <= {"memcpy", "memmove", "memset", "sqrtf", "floorf", "_GLOBAL_OFFSET_TABLE_"}


def test_no_image_holds_a_heap_a_sine_or_a_double(made: Make) -> None:
    # given all symbols of the images
    rabbit = set(re.findall(r"^ +[0-9A-F]{8} +(\w+)", (made("rabbit4000") / "onboard.map").read_text(), re.M))
    names = symbols(made("host") / "onboard") | rabbit
    names |= {name for target in ARM for name in symbols(made(target) / "onboard.elf")}

    # then these are among them, so that the list is one
    assert {"onboard_tick", "_onboard_tick", "___fsadd", "Reset_Handler"} <= names
    # and those are not
    assert sorted(n for n in names if FORBIDDEN.match(n.split("@")[0]) or DOUBLE.match(n)) == []


def test_the_rabbit_image_has_the_arithmetic_of_float_s_and_none_of_sdccs(made: Make) -> None:
    # given the map, which names the module of each symbol
    text = (made("rabbit4000") / "onboard.map").read_text()
    modules = dict(re.findall(r"^ +[0-9A-F]{8} +(\w+) +(\w+)", text, re.M))

    # then every operation on floats is float.s's
    assert {m for n, m in modules.items() if n.startswith("___fs")} == {"float"}
    assert modules["_sqrtf"] == modules["_floorf"] == "float"
    # and constants lie in flash, before the RAM
    assert int(re.search(r"([0-9A-F]{8}) +s__CONST", text)[1], 16) < 0xE000  # type: ignore[index]


class Calls:
    """The call graph that gcc tells: who calls whom, and bytes of stack of each.

    A function pointer is only called in scanner.c; where it may go stands in the drivers' tables.
    """

    def __init__(self, folder: Path) -> None:
        self.stack: dict[str, int] = {}
        self.callees: dict[str, set[str]] = {}
        protocols = "".join(p.read_text() for p in folder.glob("*.c"))
        tables = re.findall(r"scanner_protocol protocol = \{.*?, (\w+), (\w+)\}", protocols)
        for path in folder.glob("*.ci"):
            text = path.read_text()
            kinds = set(re.findall(r"bytes \((\w+)", text))
            assert kinds <= {"static"}, path.name  # no stack that grows with data
            for title, size in re.findall(r'title: "([^"]+)" label: "[^"]*?(\d+) bytes', text):
                self.stack[title] = int(size)
            for source, callee in re.findall(r'sourcename: "([^"]+)" targetname: "([^"]+)"', text):
                self.callees.setdefault(source, set()).add(callee)
        pointed = {n for n in self.stack if n.split(":")[-1] in {f for pair in tables for f in pair}}
        assert len(tables) == 3
        assert len(pointed) == 6
        pointing = {n for n, c in self.callees.items() if "__indirect_call" in c}
        assert pointing
        assert all(n.startswith(("scanner.c:", "scanner_")) for n in pointing)
        self.callees |= {n: set() for n in self.stack if n not in self.callees}
        self.callees["__indirect_call"] = pointed

    def order(self) -> list[str]:
        """Callees first; raises graphlib.CycleError if one calls itself, however far round."""
        return list(graphlib.TopologicalSorter(self.callees).static_order())

    def deepest(self, function: str) -> int:
        """Most bytes of stack from a function on."""
        deepest: dict[str, int] = {}
        for name in self.order():
            below = max((deepest[callee] for callee in self.callees.get(name, ())), default=0)
            deepest[name] = self.stack.get(name, 0) + below
        return deepest[function]


@pytest.mark.parametrize(
    ("compiler", "target"), [("gcc", "host"), *(("arm-none-eabi-gcc", target) for target in ARM)]
)
def test_no_function_of_an_image_calls_itself_and_the_stack_has_a_bound(
    compiler: str, target: str, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    # given a bundle whose compiler writes down who calls whom
    tool(compiler, {"gcc": "gcc"}.get(compiler, "gcc-arm-none-eabi"))
    write(TARGETS[target], tmp_path)
    run_make(tmp_path, f"CC={compiler}", "CFLAGS=-fcallgraph-info=su")

    # when the graph is put in order (a cycle raises)
    calls = Calls(tmp_path)
    order = calls.order()

    # then the tick is in it, and its worst path is short
    assert order.index("scanner_next") < order.index("onboard_tick") < order.index("main")
    worst = calls.deepest("main")
    record_property("stack", worst)
    print(f"{compiler}: {worst} bytes of stack")
    assert worst > calls.stack["onboard_tick"] > 0
    if target in ARM:  # and with one interrupt on top (all are of one priority) it fits
        handlers = [n for n in calls.stack if n.startswith("port.c:") or n.endswith("_Handler")]
        worst += FRAME + max(calls.deepest(n) for n in handlers if n != "Reset_Handler")
        print(f"{worst} with an interrupt")
        assert worst <= 1024  # stack_size of link.ld


def test_a_planted_recursion_is_found_in_the_call_graph(tmp_path: Path) -> None:
    # given a program with a function that calls back to the one that calls it, through a driver's table
    tool("gcc", "gcc")
    write(TARGETS["host"], tmp_path)
    path = tmp_path / "mt.c"
    head = "static bool mt_intact(const uint8_t *frame, uint8_t length)\n{\n"
    assert head in path.read_text()
    again = "    static mt other;\n    scanner_input none = {frame, length};\n\n"
    path.write_text(path.read_text().replace(head, f"{head}{again}    (void)mt_receive(&other, &none);\n"))
    run_make(tmp_path, "CC=gcc", "CFLAGS=-fcallgraph-info=su")

    # when the graph is put in order, then that is an error
    with pytest.raises(graphlib.CycleError):
        Calls(tmp_path).order()


# --- it computes the same ---


def test_firmware_with_parameters_as_constants_gives_the_same_bits() -> None:
    # given the program with fields and with macros, values of their own, and a mission that is started
    values = {"controller": {"moving_deviation": math.radians(37)}, "estimator": {"sigma_floor": 0.02}}
    plane = TangentPlane(math.radians(LATITUDE), math.radians(LONGITUDE))
    receiver, unit = Receiver(plane), InertialUnit()
    mission = Mission(Position(LATITUDE, LONGITUDE), (Position(LATITUDE + 3e-4, LONGITUDE + 1e-4),))
    orders = {0: encode(mission, 1)} | {
        k: encode(Start(mission.id), answering(k)) for k in range(10, 400, 10)
    }
    fields, constants = (open_processor("host", values, constants=c) for c in (False, True))
    assert fields.image.path != constants.image.path

    # when both make 400 ticks with a turning, accelerating animal
    records, tones = set(), set()
    for tick in range(400):
        signals = still(tick)
        signals |= {"heading_meas": math.sin(tick / 30), "accel_x": math.cos(tick / 7)}
        signals |= {"gps_north": 0.02 * tick, "gps_speed": 0.5}
        received = Received(
            receiver.fix(tick * 0.04, signals),
            unit.sample(tick, signals),
            orders.get(tick, b""),
        )
        one, other = fields.tick(received), constants.tick(received)

        # then all that they remember, play and send is the same
        assert one == other, f"tick {tick}"
        records.add(one.record)
        tones.add(one.tone_hz)
    assert len(records) == 400
    assert tones >= {0, 1500, 3500}  # the controller has led
    fields.close()
    constants.close()


def test_parameters_of_a_scenario_arrive_in_radians(tmp_path: Path, capsys: Any) -> None:
    # given a scenario with an angle in degrees
    scenario = tmp_path / "my.toml"
    scenario.write_text('[parameters]\n"cmec.moving_deviation" = 37\n')

    # when bundles are written from it, one with a further parameter, one with constants
    for options in (["--set", "cmec.capture_radius=2.5"], ["--constants"]):
        status, _ = canine(
            capsys, "firmware", "--insecure", "--target", "host", "--parameters", scenario,
            "--out", tmp_path / options[0], *options,
        )  # fmt: skip
        assert status == 0

    # then they have it in float32 radians: 37 * pi / 180 = 0.64577182
    text = (tmp_path / "--set" / "parameters.c").read_text()
    field = re.search(r"\.moving_deviation = ([\d.e-]+)f,", text)
    macro = re.search(
        r"#define CMEC_MOVING_DEVIATION ([\d.e-]+)f", (tmp_path / "--constants" / "cmec.h").read_text()
    )
    assert field
    assert macro
    assert np.float32(field[1]) == np.float32(macro[1]) == np.float32(0.64577182)
    assert ".capture_radius = 2.5f," in text
    assert "moving_deviation" not in (tmp_path / "--constants" / "parameters.c").read_text()


@pytest.mark.parametrize("navigation", [DEFAULT, Navigation(CanineTracker, CanineAhrs)], ids=lambda n: n.name)
def test_each_parameter_has_its_value_in_one_place(navigation: Navigation) -> None:
    # given a program's sources
    files = bundle.library(navigation=navigation)
    tables = dict(
        re.findall(r"struct \w+ (\w+)_parameters = \{\n(.*?)\n    \};", files["parameters.c"], re.DOTALL)
    )
    assert tables.keys() == navigation.blocks.keys()
    for member, block in navigation.blocks.items():
        # then the table of a block has a value, the unit and the meaning of each field of `par`, in its order
        declared = [v for v in block.group("parameter") if not is_mission(v)]
        rows = re.findall(r"^        \.(\w+) = [\w.-]+,? /\* (.*) \*/$", tables[member], re.MULTILINE)
        assert [name for name, _ in rows] == [v.name for v in declared]
        assert all(text.startswith(comment(v)) for (_, text), v in zip(rows, declared, strict=True))
        assert [name for _, name, _ in struct_members(files[f"{block.title()}.h"])["par"]] == [
            n for n, _ in rows
        ]
        assert f"m->{member}.par = {member}_parameters;" in files["parameters.c"]
        # and no other source sets it
        for name, text in files.items():
            assert not re.search(r"\bpar\.\w+(\[\w+\])? =(?!=)", text), name
    # and its row says which values it may have
    assert "/* s: DELAYTHRESH: least time a stop command is on; 0 to 1000 */" in files["parameters.c"]
    assert "/* m: d': distance at which a waypoint counts as reached; from 0 */" in files["parameters.c"]


# --- files ---


def test_bundles_of_the_same_inputs_have_the_same_bytes(tmp_path: Path) -> None:
    # given a bundle, when it is written again, by a process with other hashes and another time zone
    write(TARGETS["rabbit4000"], tmp_path / "one")
    script = (
        "import sys; from pathlib import Path; from codegen.firmware.bundle import write\n"
        "from codegen.firmware.key import SIMULATION_KEY; from codegen.firmware.targets import TARGETS; "
        "write(TARGETS['rabbit4000'], Path(sys.argv[1]), key=SIMULATION_KEY)"
    )
    environment = os.environ | {"PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", script, tmp_path / "two"], cwd=PROJECT, env=environment, check=True)

    # then it has the same files and bytes
    one, two = ({p.name: p.read_bytes() for p in (tmp_path / n).iterdir()} for n in ("one", "two"))
    assert one == two
    assert "README.md" in one


@pytest.mark.parametrize("target", TARGETS)
def test_no_file_of_a_bundle_names_this_machine_or_a_date(target: str) -> None:
    # given a bundle, when its texts are searched
    home, user = os.path.expanduser("~"), os.environ.get("USER", "")
    places = [str(PROJECT), sys.prefix, tempfile.gettempdir(), home, socket.gethostname()]
    for name, text in bundle.bundle(TARGETS[target]).items():
        # then there is none of these
        assert [p for p in places if len(p) > 3 and p in text] == [], name
        assert len(user) < 5 or user not in text, name
        assert re.search(r"\b20\d\d-\d\d-\d\d\b|\b\d\d:\d\d:\d\d\b", text) is None, name
        assert str(datetime.date.today().year) not in text, name


@pytest.mark.parametrize("constants", [False, True], ids=["fields", "constants"])
@pytest.mark.parametrize("target", TARGETS)
def test_the_readme_of_a_bundle_names_exactly_its_files_and_the_functions_of_the_port(
    target: str, constants: bool
) -> None:
    # given a bundle
    files = bundle.bundle(TARGETS[target], constants=constants)
    readme = files["README.md"]

    # when names are looked for in its README
    functions = set(re.findall(r"\b(port_\w+)\(", files["port.h"]))
    tables = "\n".join(line.split("|")[1] for line in readme.splitlines() if line.startswith("| "))
    listed = re.findall(r"(?<![\w.])(\w+\.(?:c|h|s|ld|md)|Makefile)(?![\w.])", tables)

    # then every file is listed once, every function is there, and no others
    assert sorted(listed) == sorted(files)
    assert len(functions) == 8
    assert set(re.findall(r"\b(port_[a-z_]+)\b", readme)) == functions
    mentioned = set(re.findall(r"(?<![\w./])(\w+\.(?:c|h|s|ld))(?![\w.])", readme))
    assert mentioned <= set(files)
    # and functions, fields (or their macros) and constants that it tells of are in the C
    c = "".join(text for name, text in files.items() if name != "README.md")
    for name in re.findall(r"`([a-z][a-z0-9]*_[a-z_]+)`", readme):
        assert name in c or name.upper() in c, name
    for name in re.findall(r"\b((?:ONBOARD|PORT|VEST)_[A-Z_]+)\b", readme):
        assert name in c, name


def test_the_readme_of_a_bundle_states_the_measured_cost_of_a_tick(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given costs of one target, as `canine pil` leaves them, and none of the others
    cost = {"ticks": 3, "clocks": {"worst": 654321, "mean": 1234}, "accesses": {"worst": 99, "mean": 98},
            "instructions": {"worst": 4321, "mean": 1}, "worst_ms_by_wait_states": [11.5, 12.25]}  # fmt: skip
    entry = {"target": "rabbit4000", "ticks": 2750, "identical": True, "with_fix": cost,
             "without_fix": cost, "stack_bytes": None, "code_bytes": 43210, "constants_bytes": 18,
             "ram_bytes": 2100, "scenario": "patrol", "seed": 1}  # fmt: skip
    path = tmp_path / "costs.json"
    path.write_text(json.dumps({"rabbit4000": {DEFAULT.name: entry}}))
    monkeypatch.setattr("codegen.firmware.bundle.COSTS", path)

    # when the READMEs are written
    rabbit, cortex, host = (
        bundle.bundle(TARGETS[t])["README.md"] for t in ("rabbit4000", "cortex-m4f", "host")
    )

    # then one tells them
    assert "over 2,750 ticks of the trial `patrol` (seed 1)" in rabbit
    assert "| with a fix, clocks | 654,321 | 1,234 |" in rabbit
    assert "| without a fix, ms of 40 at 58.98 MHz and 0, 1 wait states | 11.5, 12.25 | |" in rabbit
    assert "| code | 43,210 |" in rabbit
    assert "| stack | not known |" in rabbit
    # and the others that they are not known
    assert "Not measured: run `canine pil --target cortex-m4f`" in cortex
    assert "Not measured" in host
    assert "pil --target host" not in host


def test_each_target_has_a_port_with_every_function_of_the_interface() -> None:
    # given each target's folder, then it has a port, and every function of port.h is in it
    functions = re.findall(r"^\w[\w ]* (port_\w+)\(", (SOURCES / "port.h").read_text(), re.M)
    for target in TARGETS.values():
        text = bundle.added(target)["port.c"]
        assert [f for f in functions if not re.search(rf"^\w.* {f}\(.*\)\n\{{", text, re.M)] == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--target", "cortex-m4"], 'not for "cortex-m4"; did you mean'),
        (["--target", "host", "--set", "cmec.moving_deviaton=3"], "moving_deviaton"),
        (["--target", "host", "--set", "cmec.waypoint_north=3"], "waypoint_north"),
        (["--target", "host", "--parameters", "nowhere.toml"], "nowhere.toml"),
    ],
    ids=["target", "parameter", "mission", "scenario"],
)
def test_wrong_usage_of_canine_firmware_is_an_error_and_writes_nothing(
    arguments: list[str], message: str, tmp_path: Path, capsys: Any
) -> None:
    # given a wish that cannot be met, when it is asked for
    status, output = canine(capsys, "firmware", "--insecure", *arguments, "--out", tmp_path / "out")

    # then the answer names it, with the status of wrong usage, and there is no folder
    assert status == 2
    assert message in " ".join(output.split())
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_is_named_in_the_error(tmp_path: Path, capsys: Any) -> None:
    # given a file where a folder would have to be
    (tmp_path / "file").write_text("")

    # when the bundle is to go under it
    status, output = canine(
        capsys, "firmware", "--insecure", "--target", "host", "--out", tmp_path / "file" / "out"
    )

    # then that is wrong usage
    assert status == 2
    assert "cannot be written" in " ".join(output.split())


# --- it runs ---


def test_the_host_program_leads_over_pseudo_terminals(made: Make, tmp_path: Path) -> None:
    # given the program with a pseudo-terminal for each line
    ours: dict[str, int] = {}
    environment = {"VEST_PLAYS": str(tmp_path / "plays")}
    for name in ("GPS", "IMU", "RADIO"):
        ours[name], theirs = pty.openpty()
        tty.setraw(theirs)
        os.set_blocking(ours[name], False)
        environment[f"VEST_{name}"] = os.ttyname(theirs)

    def heard() -> bytes:
        try:
            return os.read(ours["RADIO"], 65536)
        except BlockingIOError:
            return b""

    # when instruments and operator talk to it
    with subprocess.Popen([made("host") / "onboard"], env=environment) as program:
        try:
            lines = [(lambda data, file=ours[n]: os.write(file, data)) for n in ("GPS", "IMU", "RADIO")]
            reports = lead_until_forward(*lines, heard=heard)
        finally:
            program.terminate()

    # then it answers, and plays FORWARD: 1500 Hz (Table 4.1), neither vibrator
    check_telemetry(reports)
    assert re.fullmatch(r"\d+ 1500 0 0", (tmp_path / "plays").read_text().splitlines()[-1])


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"VEST_IMU": "/dev/null", "VEST_RADIO": "/dev/null"}, "VEST_GPS: not set: expected a device"),
        ({"VEST_GPS": "/nowhere/tty"}, "VEST_GPS: /nowhere/tty: No such file or directory"),
    ],
    ids=["not set", "not there"],
)
def test_the_host_program_refuses_to_start_without_a_line(
    variables: dict[str, str], message: str, made: Make
) -> None:
    # given a line that is missing, when it is started
    done = subprocess.run(
        [made("host") / "onboard"], env=variables, capture_output=True, text=True, timeout=10, check=False
    )

    # then it says which
    assert done.returncode == 1
    assert message in done.stderr


@contextmanager
def board(program: Path, folder: Path) -> Iterator[dict[str, socket.socket]]:
    """QEMU's MPS2-AN386 with a program: sockets of its three serial ports and of its monitor."""
    names = ("radio", "gps", "imu")
    command = [tool("qemu-system-arm", "qemu-system-arm"), "-M", "mps2-an386", "-kernel", str(program)]
    command += ["-display", "none", "-nodefaults"]
    for name in names:
        command += ["-serial", f"unix:{folder / name},server=on,wait=off"]
    command += ["-monitor", f"unix:{folder / 'monitor'},server=on,wait=off"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as machine:
        try:
            sockets = {name: connect(folder / name) for name in (*names, "monitor")}
            yield sockets
            for each in sockets.values():
                each.close()
        finally:
            machine.terminate()


def connect(path: Path) -> socket.socket:
    end = time.monotonic() + 20
    while True:
        line = socket.socket(socket.AF_UNIX)
        try:
            line.connect(str(path))
        except OSError:
            line.close()
            assert time.monotonic() < end, f"QEMU did not open {path.name}"
            time.sleep(0.05)
        else:
            return line


def register(monitor: socket.socket, address: int) -> int:
    """What stands in a register of the board."""
    monitor.sendall(f"xp /1wx {address:#x}\n".encode())
    output = b""
    while not (match := re.search(rb"%016x: 0x([0-9a-f]+)" % address, output)):
        output += monitor.recv(4096)
    return int(match[1], 16)


@pytest.mark.parametrize("constants", [False, True], ids=["fields", "constants"])
def test_the_cortex_program_leads_on_a_simulated_board(constants: bool, made: Make) -> None:
    # given the program on QEMU's board (a short folder: the name of a socket has at most 107 bytes)
    with (
        tempfile.TemporaryDirectory() as folder,
        board(made("cortex-m4f", constants) / "onboard.elf", Path(folder)) as lines,
    ):
        lines["radio"].setblocking(False)

        def heard() -> bytes:
            try:
                return lines["radio"].recv(65536)
            except BlockingIOError:
                return b""

        # when instruments and operator talk to it
        reports = lead_until_forward(*(lines[n].sendall for n in ("gps", "imu", "radio")), heard=heard)
        tone = [register(lines["monitor"], at) for at in (0x40000000, 0x40000008)]
        lamps = register(lines["monitor"], 0x40028000)

    # then it answers by its UART; timer 0 runs at twice 1500 Hz (25 MHz / 3000 - 1 = 8332); no lamp is on
    check_telemetry(reports)
    assert tone == [9, 8332]
    assert lamps == 0


class SimulatedRabbit:
    """The Rabbit's bundle on ucsim, stopped where main asks for the time.

    The simulator has no peripherals: a value written to an I/O register stays there, and a read comes (a
    fault of the simulator) from the same address of the program's memory, where the tests put it.
    """

    def __init__(self, folder: Path) -> None:
        image = Image(folder / "onboard.ihx", read_map(folder / "onboard.map")[1])
        self.at, self.console, self.deepest = image.symbols, Console(image), 0
        for name in ("port_clock_ms", "onboard_tick"):
            self.console.ask(f"break {self.at[name]:#06x}", BREAKPOINT)

    def run(self) -> int:
        """Until the next stop in main, or at the begin of what it calls; where that is.

        The estimator's bank has other code at these addresses: it runs deeper in the stack.
        """
        while True:
            stop = self.console.ask("step 3000000 vclk", STOPPED)
            stack = re.search(rb"\nSP= 0x(\w{4}) (\w\w) (\w\w)", stop[0])
            assert stack
            if int(stack[1], 16) >= self.deepest:
                break
        self.deepest = self.deepest or int(stack[1], 16)
        self.caller = int(stack[3] + stack[2], 16)  # the return address, if it is at the begin of a function
        return int(stop[1], 16)

    def run_to(self, name: str) -> None:
        """It is to stop there and nowhere else."""
        assert self.run() == self.at[name], name

    def write(self, register: int, value: int) -> None:
        self.console.ask(f"set memory rom {register:#06x} {value}", re.compile(rb"0x\w+ .*\n"))

    def read(self, register: int) -> int:
        dump = self.console.ask(
            f"dump ioi {register:#06x} {register:#06x}", re.compile(rb"0x\w+ +(\w\w) .*\n")
        )
        return int(dump[1], 16)

    def interrupt(self, vector: int) -> None:
        """A handler in the place of a call of port_clock_ms, then that call again."""
        back, moved = self.caller, re.compile(rb"0x\w+ .*\n")
        self.console.ask(f"break {back:#06x}", BREAKPOINT)
        self.console.ask(f"pc {vector:#06x}", moved)
        assert self.run() == back
        self.console.ask(f"clear {back:#06x}", NOTHING)
        self.console.ask(f"pc {back - 3:#06x}", moved)
        self.run_to("port_clock_ms")


def test_the_rabbits_port_moves_bytes_both_ways_with_its_registers_as_memory(
    tmp_path: Path, made: Make
) -> None:
    # given the program on the simulator, linked so that the registers' addresses are free, after port_init
    settings = rabbit_tools()
    for path in made("rabbit4000").iterdir():
        shutil.copy2(path, tmp_path)
    (tmp_path / "onboard.ihx").unlink()
    run_make(tmp_path, "CODE=0x0200", *settings)
    rabbit = SimulatedRabbit(tmp_path)
    rtc1r = 0x03
    scdr, scsr, sddr, sdsr, sedr, sesr = 0xE0, 0xE3, 0xF0, 0xF3, 0xC8, 0xCB
    rabbit.run_to("port_clock_ms")
    # the session is the clock's bytes 1 to 4, as they were at power-up
    seal = Seal(SIMULATION_KEY, int.from_bytes(rabbit.console.memory(rtc1r, 4), "little"))
    for register in (rtc1r, scsr, sdsr, sesr):
        rabbit.write(register, 0)

    # then the dividers are 58982400 / 32 / baud - 1: 31, 47, 15 for 57600, 38400, 115200
    assert [rabbit.read(at) for at in (0xAD, 0xAF, 0xA5)] == [31, 47, 15]

    # when a fix, a sample, a mission and its start, too early, come by interrupts, and three ticks are
    # made: that with the fix, after 46.9 ms (6 of 256/32768 s) that which listens to the operator, and after
    # 85.9 ms that which answers
    plane = TangentPlane(math.radians(LATITUDE), math.radians(LONGITUDE))
    signals = still(0)
    mission = Mission(Position(LATITUDE, LONGITUDE), (Position(LATITUDE, LONGITUDE + 1e-3),))
    for vector, data, status, stream in (
        (0xE0F0, sddr, sdsr, Receiver(plane).fix(0.0, signals)),
        (0xE1C0, sedr, sesr, InertialUnit().sample(0, signals)),
        (0xE0E0, scdr, scsr, encode(mission, 1, seal) + encode(Start(mission.id), 2, seal)),
    ):
        for byte in stream:
            rabbit.write(data, byte)
            rabbit.write(status, 0x80)
            rabbit.interrupt(vector)
        rabbit.write(status, 0)
    rabbit.run_to("port_clock_ms")
    rabbit.run_to("onboard_tick")
    rabbit.run_to("port_clock_ms")
    for clock in (6, 11):
        rabbit.write(rtc1r, clock)
        rabbit.run_to("onboard_tick")
        rabbit.run_to("port_clock_ms")

    # then the telemetry leaves byte by byte, each with an interrupt
    sent = [rabbit.read(scdr)]
    for _ in range(Decoder.SIZE - 1):
        rabbit.interrupt(0xE0E0)
        sent.append(rabbit.read(scdr))
    ((_, report),) = Decoder(SIMULATION_KEY).receive(bytes(sent))
    assert Flag(report.flags) == Flag.VALID | Flag.IMU_OK | Flag.LINK_OK | Flag.FIXED | Flag.LOADED
    assert (report.gps_frames, report.imu_frames, report.received, report.command) == (3, 1, 2, 2)
    assert report.refusal == Refusal.NOT_PLANNED
    assert abs(report.heading - 15_708) <= 1
    # and the watchdog was hit
    assert rabbit.read(0x08) == 0x5A

    # when 117.2 ms have passed since the first tick, then the fourth is not due; after 125 ms it is
    rabbit.write(rtc1r, 15)
    rabbit.run_to("port_clock_ms")
    rabbit.write(rtc1r, 16)
    rabbit.run_to("onboard_tick")
    rabbit.console.close()


# --- rings ---

RING = """#include "ring.h"
static ring r;
int put(int byte);
int take(void);
int room(void);
int lend(uint8_t *copy);
int put(int byte) { ring_put(&r, (uint8_t)byte); return r.put; }
int take(void) { uint8_t byte = 0U; return ring_take(&r, &byte) ? byte : -1; }
int room(void) { return ring_room(&r); }
int lend(uint8_t *copy) {
    const uint8_t *bytes;
    const int count = ring_lend(&r, &bytes);
    for (int i = 0; i < count; i++) { copy[i] = bytes[i]; }
    return count;
}
"""


def test_a_ring_gives_back_in_order_what_was_put_and_drops_what_has_no_room(tmp_path: Path) -> None:
    # given an empty ring of 256 places, of which one stays free
    (tmp_path / "ring.h").write_text((SOURCES / "ring.h").read_text())
    (tmp_path / "ring.c").write_text(RING)
    flags = tuple(f for f in FLAGS if f != "-fvisibility=hidden")
    ring = ctypes.CDLL(str(build_library(tmp_path, ["ring.c"], tmp_path / "r.so", what="ring", flags=flags)))
    assert ring.take() == -1
    assert ring.room() == 255
    lent = (ctypes.c_uint8 * 256)()
    for turn in range(5):  # from other places each time: 0, 255, 254...
        # when 300 bytes are put
        for i in range(300):
            ring.put((i + turn) % 256)

        # then the first 255 are there, in order, those up to the end of the ring first
        assert ring.room() == 0
        taken: list[int] = []
        for count in (255,) if turn == 0 else (turn, 255 - turn):
            assert ring.lend(lent) == count
            # and the bytes lent keep their place: only those lent before are free again
            assert ring.room() == len(taken)
            taken += lent[:count]
        assert taken == [(i + turn) % 256 for i in range(255)]
        # and nothing is left
        assert ring.lend(lent) == 0
        assert ring.room() == 255
        assert ring.take() == -1

    # when one byte is put, then it can be taken by itself
    ring.put(7)
    assert (ring.take(), ring.take()) == (7, -1)


def test_every_block_of_the_program_is_in_every_bundle() -> None:
    # given the bundles, then all have C and header of all blocks, and no mailbox of the processor in the loop
    for target in TARGETS.values():
        names = set(bundle.bundle(target))
        assert {f"{b.title()}.{kind}" for b in BLOCKS.values() for kind in "ch"} <= names
        assert not any(name.startswith("pil") for name in names)


# --- what an engineer has written is kept ---


def test_a_bundle_replaces_an_earlier_one_but_no_file_that_was_changed(tmp_path: Path) -> None:
    # given a bundle, made once more with other parameters
    write(TARGETS["host"], tmp_path)
    write(TARGETS["host"], tmp_path, {"controller": {"moving_deviation": 0.5}})
    assert ".moving_deviation = 0.5f," in (tmp_path / "parameters.c").read_text()
    checked = subprocess.run(["sha256sum", "-c", "--quiet", bundle.SUMS], cwd=tmp_path, check=False)
    assert checked.returncode == 0
    # when its port has been changed, then it is named, and nothing is written
    port = tmp_path / "port.c"
    port.write_text(port.read_text() + "/* ours */\n")
    with pytest.raises(UsageError, match=r"not made here: port\.c; nothing is written"):
        write(TARGETS["host"], tmp_path)
    assert port.read_text().endswith("/* ours */\n")
    assert ".moving_deviation = 0.5f," in (tmp_path / "parameters.c").read_text()


def test_a_bundle_overwrites_no_file_that_was_not_made_here(tmp_path: Path) -> None:
    (tmp_path / "main.c").write_text("int main(void) { return 0; }\n")
    with pytest.raises(UsageError, match=r"main\.c"):
        write(TARGETS["cortex-m4f"], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["main.c"]


@pytest.mark.parametrize("asked", TARGETS)
@pytest.mark.parametrize("held", TARGETS)
def test_a_folder_takes_the_bundles_of_one_target(
    held: str, asked: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a bundle, and a file of the engineer's
    bundle.write(TARGETS[held], tmp_path, key=None)
    (tmp_path / "notes.c").write_text("/* ours */\n")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    # when one for the same or another target is written into its folder
    status, error = canine(capsys, "firmware", "--insecure", "--target", asked, "--out", tmp_path)
    # then another is refused, naming both
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    if asked == held:
        assert status == 0
    else:
        assert status == 2
        assert error == (
            f"canine: --out {tmp_path}: holds firmware for {held}, and that for {asked} would mix with it; "
            "nothing is written. Choose another folder, or empty this one\n"
        )


def test_a_folder_with_another_targets_sources_that_no_bundle_lists_is_refused(tmp_path: Path) -> None:
    # given two bundles mixed by an earlier version, which listed those of the last
    write(TARGETS["cortex-m4f"], tmp_path)
    (tmp_path / bundle.SUMS).unlink()
    (tmp_path / "port.c").unlink()
    (tmp_path / "Makefile").unlink()
    with pytest.raises(UsageError, match="holds firmware for cortex-m4f, and that for host would mix"):
        write(TARGETS["host"], tmp_path)


def test_a_bundle_takes_the_place_of_an_earlier_one_whole(tmp_path: Path) -> None:
    # given a bundle of an earlier version with two files more, of which one was changed
    write(TARGETS["host"], tmp_path)
    sums = tmp_path / bundle.SUMS
    for name in ("old.c", "kept.c"):
        (tmp_path / name).write_text("int x;\n")
        sums.write_text(f"{sums.read_text()}{hashlib.sha256(b'int x;' + bytes([10])).hexdigest()}  {name}\n")
    (tmp_path / "kept.c").write_text("int y;\n")
    # when it is made again
    write(TARGETS["host"], tmp_path)
    # then the one as it was made is gone, the changed one is not, and the list is that of the bundle
    assert not (tmp_path / "old.c").exists()
    assert (tmp_path / "kept.c").read_text() == "int y;\n"
    assert "old.c" not in sums.read_text()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("command_module.stop_tone=0", "is 0 Hz, as for NONE"),
        ("command_module.stop_tone=1500", "is 1500 Hz, as for FORWARD"),
        ("command_module.stop_tone=3500.5", "is 3500.5 Hz, not a whole number"),
        ("canine.drift=3", "--set canine.drift=3: not in the firmware"),
        ("cmec.waypoint_count=3", "waypoints and home come by radio"),
    ],
)
def test_a_vest_with_ambiguous_or_fractional_tones_is_refused(
    setting: str, message: str, capsys: Any, tmp_path: Path
) -> None:
    status, error = canine(
        capsys, "firmware", "--insecure", "--target", "host", "--out", tmp_path / "fw", "--set", setting
    )
    assert status == 2
    assert message in error.replace("\n", " ")
    assert not (tmp_path / "fw").exists()

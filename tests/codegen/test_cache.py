"""Results in the user's cache: made once, whole, never trusted unseen."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from codegen import cache
from codegen.files import write_whole


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_folder", lambda: tmp_path)


def fail(path: Path) -> None:
    pytest.fail(f"{path} was made again")


def test_an_entry_is_made_once_for_what_is_asked() -> None:
    first = cache.kept("room/a.txt", ("asked", 1.5), lambda path: path.write_text("one"))
    other = cache.kept("room/a.txt", ("asked", 2.5), lambda path: path.write_text("two"))
    assert cache.kept("room/a.txt", ("asked", 1.5), fail) == first
    assert (first.read_text(), other.read_text()) == ("one", "two")


def test_an_entry_belongs_to_the_sources_it_was_made_from(monkeypatch: pytest.MonkeyPatch) -> None:
    before = cache.kept("a.txt", "asked", lambda path: path.write_text("one"))
    monkeypatch.setattr(cache, "_traced", lambda: "edited")
    after = cache.kept("a.txt", "asked", lambda path: path.write_text("two"))
    assert (before.read_text(), after.read_text()) == ("one", "two")


@pytest.mark.parametrize("damage", ["content", "hash", "no content", "no hash"])
def test_a_damaged_entry_is_made_anew(damage: str) -> None:
    # given
    entry = cache.kept("a.txt", "asked", lambda path: path.write_text("right"))
    hash_of_it = entry.with_name(f"{entry.name}.sha256")
    damaged = entry if "content" in damage else hash_of_it
    if damage.startswith("no"):
        damaged.unlink()
    else:
        damaged.write_text("rihgt")
    # when, then
    assert cache.kept("a.txt", "asked", lambda path: path.write_text("right")).read_text() == "right"
    cache.kept("a.txt", "asked", fail)


def test_an_entry_whose_making_failed_is_made_by_the_next_one() -> None:
    def interrupted(path: Path) -> None:
        path.write_text("ri")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cache.kept("a.txt", "asked", interrupted)
    assert cache.kept("a.txt", "asked", lambda path: path.write_text("right")).read_text() == "right"


def test_several_at_once_make_the_same_entry() -> None:
    together = Barrier(8)

    def make(path: Path) -> None:
        together.wait()
        write_whole(path, b"right")

    with ThreadPoolExecutor(8) as pool:
        entries = list(pool.map(lambda _: cache.kept("a.txt", "asked", make), range(8)))
    assert {entry.read_bytes() for entry in entries} == {b"right"}
    cache.kept("a.txt", "asked", fail)


def test_an_entry_that_its_input_decides_alone_outlives_an_edit(monkeypatch: pytest.MonkeyPatch) -> None:
    first = cache.stored("a.txt", "asked", lambda path: path.write_text("one"))
    monkeypatch.setattr(cache, "is_edited", lambda floors: True)
    monkeypatch.setattr(cache, "_traced", lambda: "edited")
    assert cache.stored("a.txt", "asked", fail) == first


def test_what_cannot_be_stored_serves_this_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, content: bytes) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cache, "write_whole", refuse)
    path = cache.kept("room/a.txt", "asked", lambda path: path.write_text("right"))
    assert path.read_text() == "right"
    assert tmp_path not in path.parents


def test_entries_unused_for_90_days_go_when_another_is_stored() -> None:
    # given an entry that nobody used for 91 days, one for 89, and one that was used just now
    names = ("unused", "rare", "used")
    entries = {name: cache.kept("room/a.txt", name, lambda path: path.write_text("one")) for name in names}
    for name, days in (("unused", 91), ("rare", 89), ("used", 91)):
        for file in (entries[name], entries[name].with_name(f"{entries[name].name}.sha256")):
            os.utime(file, (time.time() - 86_400 * days,) * 2)
    cache.kept("room/a.txt", "used", fail)
    # when another is stored
    another = cache.kept("room/a.txt", "another", lambda path: path.write_text("two"))
    # then the first is gone, with its hash
    left = [entries["rare"], entries["used"], another]
    assert sorted(another.parent.iterdir()) == sorted(
        [*left, *(path.with_name(f"{path.name}.sha256") for path in left)]
    )


@pytest.fixture
def floors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of what decides the C of a model."""
    for floor in cache.TRACED:
        shutil.copytree(
            cache.FLOORS / floor, tmp_path / "copy" / floor, ignore=shutil.ignore_patterns("__pycache__")
        )
    monkeypatch.setattr(cache, "FLOORS", tmp_path / "copy")
    return tmp_path / "copy"


@pytest.mark.parametrize(
    "name",
    [
        "models/cmec.py",
        "models/kit/tracing.py",
        "codegen/batch/lanes.py",
        "codegen/blocks/templates/block.c.jinja",
        "codegen/firmware/onboard/link.h",
        "codegen/firmware/onboard/link.c",
    ],
)
def test_one_byte_of_a_source_decides(floors: Path, name: str) -> None:
    before = cache.sources(cache.TRACED, cache.TOOLS)
    content = bytearray((floors / name).read_bytes())
    content[-2] ^= 1
    (floors / name).write_bytes(content)
    assert cache.sources(cache.TRACED, cache.TOOLS) != before


def test_what_is_no_source_does_not_decide(floors: Path) -> None:
    before = cache.sources(cache.TRACED, cache.TOOLS)
    (floors / "models" / "__pycache__").mkdir()
    (floors / "models" / "__pycache__" / "cmec.cpython-311.pyc").write_bytes(b"compiled")
    assert cache.sources(cache.TRACED, cache.TOOLS) == before


def test_a_file_beside_the_floors_decides_where_it_is_named(floors: Path) -> None:
    named = (*cache.TRACED, "alone.py")
    (floors / "alone.py").write_text("1")
    before = cache.sources(named, ()), cache.sources(cache.TRACED, ())
    (floors / "alone.py").write_text("2")
    assert cache.sources(named, ()) != before[0]
    assert cache.sources(cache.TRACED, ()) == before[1]


@pytest.mark.parametrize("package", ["ziglang", "casadi", "jinja2", "python"])
def test_the_version_of_a_tool_decides(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def changed(version: Callable[[str], str]) -> Callable[[str], str]:
        return lambda name: "0.0.1" if name == package else version(name)

    before = cache.sources(cache.TRACED, cache.TOOLS)
    if package == "python":
        monkeypatch.setattr("platform.python_version", lambda: "3.99.0")
    else:
        monkeypatch.setattr(cache, "_version", changed(cache._version))
    assert cache.sources(cache.TRACED, cache.TOOLS) != before


def equation(floors: Path, folder: Path, edit: str = "") -> tuple[str, bool]:
    """What a process of its own gets from the cache, and whether it came to lie there.

    Args:
        edit: Python between the import of the model and the question; `source` is the model's file.
    """
    script = f"""
from pathlib import Path
from codegen import cache
from models import cmec
source = Path(cmec.__file__)
{edit}
path = cache.kept("room/a.txt", "asked", lambda path: path.write_text(str(cmec.MAX_WAYPOINTS)))
print(path.read_text(), cache.cache_folder() in path.parents)
"""
    environment = os.environ | {"PYTHONPATH": str(floors), "ZIG_GLOBAL_CACHE_DIR": str(folder)}
    time.sleep(2 * cache.GRAIN)  # a file as new as that counts as edited
    done = subprocess.run(
        [sys.executable, "-P", "-c", script],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    text, is_there = done.stdout.split()
    return text, is_there == "True"


EDIT = "source.write_text(source.read_text().replace('MAX_WAYPOINTS = 16', 'MAX_WAYPOINTS = 8'))"


@pytest.mark.parametrize(
    "edit", [EDIT, f"cache._traced(); {EDIT}", f"{EDIT}; import os; os.utime(source, (1e9, 1e9))"]
)
def test_a_process_whose_models_were_edited_leaves_the_cache_alone(
    floors: Path, tmp_path: Path, edit: str
) -> None:
    # given an entry of the models as they are
    assert equation(floors, tmp_path) == ("16", True)
    # when a model is edited after a process has imported it, then that process keeps its equations for itself
    assert equation(floors, tmp_path, edit) == ("16", False)
    # and the next one gets those of the file
    assert equation(floors, tmp_path) == ("8", True)
    assert equation(floors, tmp_path) == ("8", True)


def test_an_edit_while_an_entry_is_made_keeps_it_out_of_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter([False, True])
    monkeypatch.setattr(cache, "is_edited", lambda floors: next(answers))
    path = cache.kept("a.txt", "asked", lambda path: path.write_text("which?"))
    assert path.read_text() == "which?"
    assert tmp_path not in path.parents

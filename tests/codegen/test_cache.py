"""Results in the user's cache: made once, whole, never trusted unseen."""

from __future__ import annotations

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
    monkeypatch.setattr(cache, "sources", lambda: "edited")
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

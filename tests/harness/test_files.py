"""Files of results that belong together: those of two sets never stand beside each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.files import FileError, write_set


def held(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_set_takes_the_place_of_the_one_before(tmp_path: Path) -> None:
    # given a set of three, and a file of the user
    write_set(tmp_path / "new", {"a": b"1", "b": b"1", "c": b"1"})
    (tmp_path / "new" / "mine").write_bytes(b"0")
    # when one of two is written
    write_set(tmp_path / "new", {"b": b"2", "a": b"2"}, ("c", "d"))
    # then
    assert held(tmp_path / "new") == {"a": b"2", "b": b"2", "mine": b"0"}


def test_a_set_that_ends_between_two_files_leaves_none_of_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given
    write_set(tmp_path, {"a": b"1", "b": b"1"})
    put = Path.replace

    def interrupted(path: Path, target: Path) -> Path:
        if path.name == "b":
            raise KeyboardInterrupt
        return put(path, target)

    # when it ends before its second file is in its place
    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_set(tmp_path, {"a": b"2", "b": b"2"})
    # then
    assert held(tmp_path) == {"a": b"2"}
    assert len(list(tmp_path.iterdir())) == 1


def test_a_set_that_cannot_be_made_leaves_the_one_before(tmp_path: Path) -> None:
    # given
    write_set(tmp_path, {"a": b"1", "b": b"1"})
    # when a file of the new one cannot be made
    with pytest.raises(FileError, match=r"cannot be written \(No such file or directory\); make room"):
        write_set(tmp_path, {"a": b"2", "none/b": b"2"})
    # then
    assert held(tmp_path) == {"a": b"1", "b": b"1"}


def test_a_file_that_cannot_be_made_is_named_by_its_own_place(tmp_path: Path) -> None:
    # given a name that is longer than the file system takes
    name = 300 * "b"
    with pytest.raises(FileError) as caught:
        write_set(tmp_path, {"a": b"1", name: b"1"})
    # then
    assert str(caught.value).startswith(f"{tmp_path / name}: cannot be written (File name too long)")
    assert held(tmp_path) == {}


def test_a_folder_in_the_place_of_a_file_leaves_the_set_before(tmp_path: Path) -> None:
    # given
    write_set(tmp_path, {"a": b"1"})
    (tmp_path / "b").mkdir()
    # then
    with pytest.raises(FileError, match="b: is a folder; remove it, or choose another folder"):
        write_set(tmp_path, {"a": b"2", "b": b"2"})
    assert held(tmp_path) == {"a": b"1"}

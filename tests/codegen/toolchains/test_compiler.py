"""One compiler for every platform: the same bytes, the compiler's own words, a cache that can be written."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from pathlib import Path

import pytest

from codegen.toolchains import compiler
from codegen.toolchains.compiler import (
    NUMERICS,
    PLATFORMS,
    CompileError,
    build_library,
    find_platform,
    this_platform,
    zig,
)

SOURCE = """
#include <math.h>
__attribute__((visibility("default"))) double answer(double x);
double hidden(double x);
double hidden(double x) { return floor(x); }
__attribute__((visibility("default"))) double answer(double x) { return hidden(x) * 2.0; }
"""


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    folder = tmp_path / "sources"
    folder.mkdir()
    (folder / "answer.c").write_text(SOURCE)
    return folder


@pytest.fixture
def fresh_cache() -> Iterator[None]:
    compiler.cache_folder.cache_clear()
    yield
    compiler.cache_folder.cache_clear()


def test_a_library_exports_only_its_visible_symbols(sources: Path, tmp_path: Path) -> None:
    suffix = PLATFORMS[this_platform()].suffix
    path = build_library(sources, ["answer.c"], tmp_path / f"answer{suffix}", what="answer")
    loaded = ctypes.CDLL(str(path))
    loaded.answer.restype, loaded.answer.argtypes = ctypes.c_double, [ctypes.c_double]
    assert loaded.answer(2.75) == 4.0
    assert not hasattr(loaded, "hidden")
    assert sorted(p.name for p in tmp_path.iterdir()) == [path.name, "sources"]


def test_the_same_sources_in_other_folders_give_the_same_library(sources: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "a" / "longer" / "path"
    elsewhere.mkdir(parents=True)
    (elsewhere / "answer.c").write_text(SOURCE)
    one = build_library(
        sources, ["answer.c"], tmp_path / "one" / "answer.so", what="answer", target="linux64"
    )
    two = build_library(
        elsewhere, ["answer.c"], tmp_path / "two" / "answer.so", what="answer", target="linux64"
    )
    assert one.read_bytes() == two.read_bytes()
    assert str(tmp_path).encode() not in one.read_bytes()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("int x = ;\n", "error: expected expression"),
        (
            "float f(double x);\nfloat f(double x) { return x; }\n",
            "implicit conversion loses floating-point precision",
        ),
        ("double f(float x);\ndouble f(float x) { return x * 2.0; }\n", "increases floating-point precision"),
    ],
)
def test_c_that_does_not_compile_is_reported_in_the_compilers_words(
    text: str, words: str, sources: Path, tmp_path: Path
) -> None:
    (sources / "answer.c").write_text(text)
    output = tmp_path / "answer.so"
    with pytest.raises(CompileError) as error:
        build_library(sources, ["answer.c"], output, what="the answer")
    assert str(error.value).startswith("the answer: ziglang ")
    assert "answer.c:" in str(error.value)
    assert words in str(error.value)
    assert not output.exists()


def test_compiled_products_and_sums_are_rounded_one_by_one(sources: Path, tmp_path: Path) -> None:
    # given a processor with fused multiply-add
    (sources / "answer.c").write_text("double f(double a, double b, double c) { return a * b + c; }\n")
    assembly = tmp_path / "answer.s"
    common = ["cc", "-target", "aarch64-linux-gnu", "-S", "-o", str(assembly), "answer.c"]
    # then the flags keep the compiler from fusing, which it does without them
    zig([*common, *NUMERICS], "answer", sources)
    assert "fmadd" not in assembly.read_text()
    zig([*common, "-O2", "-ffp-contract=fast"], "answer", sources)
    assert "fmadd" in assembly.read_text()


def test_platforms_are_known_by_all_their_names() -> None:
    assert find_platform("linux64") is find_platform("x86_64-linux") is PLATFORMS["linux64"]
    assert find_platform("win64") is find_platform("x86_64-windows")
    assert find_platform("aarch64-darwin") is PLATFORMS["aarch64-darwin"]
    with pytest.raises(CompileError, match='platform "win46" is not known; did you mean "win64"'):
        find_platform("win46")


@pytest.mark.usefixtures("fresh_cache")
def test_a_read_only_home_gives_a_temporary_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a home in which nothing can be made (a file stands where the folder would)
    (tmp_path / ".cache").write_text("")
    monkeypatch.delenv("ZIG_GLOBAL_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    scratch = tmp_path / "tmp"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    # then the cache is in the folder for temporary files, the same every time
    first = compiler.cache_folder()
    assert first.parent == scratch
    compiler.cache_folder.cache_clear()
    assert compiler.cache_folder() == first


@pytest.mark.usefixtures("fresh_cache")
def test_the_users_cache_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ZIG_GLOBAL_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert compiler.cache_folder() == tmp_path / "cache" / "guided-canine"
    compiler.cache_folder.cache_clear()
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "zig"))
    assert compiler.cache_folder() == tmp_path / "zig"

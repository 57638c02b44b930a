"""The parts of the pages: the libraries are whole and licensed, and what is inlined keeps its meaning."""

import base64
import hashlib
import re

import pytest

from harness.report.inline import LIBRARIES, PARTS, SCRIPTS, STYLES, policy, script, style

PUBLISHED = {  # SHA-256 of the files in the packages that npm serves
    "leaflet-1.9.4/leaflet.js": "db49d009c841f5ca34a888c96511ae936fd9f5533e90d8b2c4d57596f4e5641a",
    "leaflet-1.9.4/leaflet.css": "a7837102824184820dfa198d1ebcd109ff6d0ff9a2672a074b9a1b4d147d04c6",
    "leaflet-1.9.4/LICENSE": "53e8dc25862014e4324741ca18fbe3611e11d42ef69f59f86ea8c5389647d4cb",
    "uplot-1.6.32/uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uplot-1.6.32/uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
    "uplot-1.6.32/LICENSE": "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd",
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_libraries_are_as_they_were_published(name: str) -> None:
    assert hashlib.sha256((PARTS / name).read_bytes()).hexdigest() == PUBLISHED[name]


def test_the_libraries_are_all_that_is_not_ours() -> None:
    folders = {path.name for path in PARTS.iterdir() if path.is_dir()}
    files = {str(path.relative_to(PARTS)) for folder in folders for path in (PARTS / folder).iterdir()}
    assert files == set(PUBLISHED)
    assert set(SCRIPTS) | set(STYLES) == {
        str(path.relative_to(PARTS)) for path in PARTS.rglob("*") if path.suffix in (".js", ".css")
    }


@pytest.mark.parametrize("name", [name for name in SCRIPTS if name not in LIBRARIES])
def test_our_scripts_make_no_html_and_no_code_of_text(name: str) -> None:
    text = (PARTS / name).read_text()
    assert not re.search(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|on\w+=\"", text
    )
    assert "fetch(" not in text
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")


@pytest.mark.parametrize("name", [name for name in SCRIPTS if name not in LIBRARIES])
def test_no_literal_of_our_scripts_goes_over_several_lines(name: str) -> None:
    lines = (PARTS / name).read_text().splitlines()
    assert [line for line in lines if line.count("`") % 2] == []


def test_an_inlined_script_has_its_statements_and_no_comments() -> None:
    assert script("map.js").startswith('(function () {\n"use strict";')
    assert "// " not in "\n".join(line for line in script("map.js").splitlines() if line.startswith("/"))
    assert "sourceMappingURL" not in script(LIBRARIES[0])
    assert script(LIBRARIES[0]).startswith("/* @preserve\n * Leaflet 1.9.4".replace("\n ", "\n"))


def test_an_inlined_style_asks_for_no_file() -> None:
    for name in STYLES:
        assert "url(" not in style(name).replace("url(#default#VML)", "")
    assert ".leaflet-pane,.leaflet-tile" in style(STYLES[0])
    assert "popup" not in style(STYLES[0])


def test_the_policy_names_each_script_and_style_by_its_hash() -> None:
    digest = base64.b64encode(hashlib.sha256(b"let x = 1;").digest()).decode()
    assert policy(["let x = 1;"], ["p{}"]).split("; ")[:2] == [
        "default-src 'none'",
        f"script-src 'sha256-{digest}'",
    ]

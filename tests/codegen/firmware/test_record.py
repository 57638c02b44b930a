"""The record of the processor in the loop: derived from the headers and the blocks."""

from __future__ import annotations

import textwrap

import pytest

from codegen.firmware.bundle import BLOCKS, headers, program, recorded
from codegen.firmware.record import INSTEAD, UNNAMED, Entry, drivers
from codegen.firmware.structs import Headers, Member, read_headers
from models.errors import DeclarationError
from models.kit.declaration import Type


def program_with(header: str, before: str, after: str) -> Headers:
    """The program's structs with one header changed."""
    files = program()
    assert before in files[header]
    files[header] = files[header].replace(before, after)
    return read_headers({name: text for name, text in files.items() if name.endswith(".h")})


def words(declared: Headers) -> dict[str, Entry]:
    return {entry.name: entry for entry in drivers(declared, BLOCKS)}


def test_members_of_a_struct_are_read_with_type_and_size() -> None:
    text = textwrap.dedent("""
    #define ROWS 3U /* of a */
    typedef struct {
        const uint8_t *place; /* a; comment */
        volatile uint8_t a[2U * ROWS];
        bool (*intact)(const uint8_t *frame, uint8_t length);
        other inner;
    } thing;
    typedef enum { RED, /* first */
        GREEN = 4 } colour;
    typedef enum { NORTH, EAST = 2, SOUTH, } direction;
    """)
    declared = read_headers({"thing.h": text})
    assert declared.structs == {
        "thing": (
            Member("uint8_t *", "place"),
            Member("uint8_t", "a", 6),
            Member("function *", "intact"),
            Member("other", "inner"),
        )
    }
    assert declared.enums == {"colour": ("RED", "GREEN"), "direction": ("NORTH", "EAST", "SOUTH")}


def test_a_member_that_is_not_plain_c_is_refused_by_name() -> None:
    with pytest.raises(DeclarationError, match="thing: `unsigned a : 3` is not read"):
        read_headers({"thing.h": "typedef struct { unsigned a : 3; } thing;"})


def test_an_array_whose_size_no_header_states_is_refused_by_name() -> None:
    with pytest.raises(DeclarationError, match=r"thing: `uint8_t a\[ROWS\]` is not read"):
        read_headers({"thing.h": "typedef struct { uint8_t a[ROWS]; } thing;"})


def test_a_member_added_to_a_header_is_recorded() -> None:
    # given one more counter of the receiver's driver, and one more flag of the program
    declared = program_with("ubx.h", "    uint32_t refused;", "    uint16_t seen[3]; uint32_t refused;")
    assert words(declared).keys() - words(headers()).keys() == {"gps.seen"}
    entry = words(declared)["gps.seen"]
    assert (entry.c, entry.words) == ("gps.seen[0]", ["gps.seen[1]", "gps.seen[2]", "gps.seen[3]"])
    declared = program_with("onboard.h", "    bool busy;", "    bool busy; bool idle;")
    assert words(declared)["idle"].type is Type.BOOLEAN


def test_a_member_of_an_unknown_type_is_refused_by_name() -> None:
    declared = program_with("onboard.h", "    bool busy;", "    bool busy; double mass;")
    with pytest.raises(DeclarationError, match=r"onboard\.mass is `double`; expected a scalar"):
        words(declared)


def test_a_block_that_the_bundle_does_not_know_is_refused_by_name() -> None:
    declared = program_with("onboard.h", "    bool busy;", "    bool busy; six_state other;")
    with pytest.raises(DeclarationError, match=r"onboard\.other is `six_state`"):
        words(declared)


def test_record_names_the_words_of_drivers_and_blocks_by_their_place() -> None:
    # by hand from the headers: a sample's values, the mission's waypoints, a scanner's counters, a fix
    names = set(recorded())
    assert {
        "imu.accel_x",
        "imu.heading",
        "radio.mission.latitude[16]",
        "radio.mission.home.longitude",
    } <= names
    assert {"gps.errors", "gps.held", "gps.fix.h_acc", "gps.epoch.course", "time_ms", "radio.told"} <= names
    assert {"controller.state.now", "controller.parameter.waypoint_north[1]"} <= names
    # other parameters than the mission do not change
    assert "controller.parameter.capture_radius" not in names


def test_what_is_recorded_in_another_form_is_in_the_headers() -> None:
    structs = headers().structs
    assert all(name in [member.name for member in structs[struct]] for struct, name in [*INSTEAD, *UNNAMED])


def test_two_words_of_one_name_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    # given a counter of the radio's own with the name of its scanner's, whose name is left out
    declared = program_with("link.h", "    uint32_t refused;", "    uint32_t errors; uint32_t refused;")
    monkeypatch.setattr("codegen.firmware.bundle.headers", lambda navigation: declared)
    recorded.cache_clear()
    # when the record is named, then no word is lost in silence
    with pytest.raises(DeclarationError, match=r'two words are called "radio\.errors"'):
        recorded()


def test_the_name_of_another_struct_s_scanner_is_kept() -> None:
    # given a scanner in a struct that is not among those whose scanner has no name
    declared = program_with("onboard.h", "    bool busy;", "    bool busy; scanner scanner;")
    assert {"scanner.errors", "radio.errors"} <= words(declared).keys()
    assert "errors" not in words(declared)

"""Bytes go through a wire both ways; those without room are lost."""

from __future__ import annotations

from harness.vest.port import ROOM, wire


def test_each_end_of_a_wire_reads_what_the_other_wrote() -> None:
    here, there = wire()

    here.write(b"ab")
    here.write(b"c")
    there.write(b"xyz")

    assert (there.read(), here.read()) == (b"abc", b"xyz")
    assert (there.read(), here.read()) == (b"", b"")


def test_bytes_beyond_the_room_of_a_wire_are_lost_until_it_is_read() -> None:
    here, there = wire()

    here.write(bytes(ROOM - 1))
    here.write(b"kept lost")
    here.write(b"lost")

    assert there.read() == bytes(ROOM - 1) + b"k"
    here.write(b"again")
    assert there.read() == b"again"

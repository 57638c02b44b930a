"""Who may come in over the network."""

from __future__ import annotations

import socket

import pytest

from harness.station.guard import Guard, token_of
from harness.station.server import address_of, listening
from models.errors import UsageError


def refusal(bind: str, host: str, origin: str | None = None, token: str = "") -> str:
    headers = {"host": host} | ({} if origin is None else {"origin": origin})
    return Guard(bind, "" if bind == "127.0.0.1" else "secret").refusal(headers, token)


@pytest.mark.parametrize(
    "host", ["localhost:8642", "127.0.0.1:8642", "[::1]:8642", "localhost", "127.0.0.2:1"]
)
def test_this_machine_is_known_by_its_own_names(host: str) -> None:
    assert refusal("127.0.0.1", host, f"http://{host}") == ""
    assert refusal("127.0.0.1", host, f"https://{host}") == "", "behind a proxy with TLS"
    assert refusal("127.0.0.1", host) == "", "a script states no Origin"


@pytest.mark.parametrize(
    "host", ["evil.example:8642", "localhost.evil.example", "10.1.2.3:8642", "", "[::1", "127.0.0.1.nip.io"]
)
def test_a_name_that_is_pointed_at_this_machine_is_refused(host: str) -> None:
    assert refusal("127.0.0.1", host, f"http://{host}") == "the Host is not this station"


def test_this_machines_own_name_lets_in_only_where_others_reach_the_station(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "laptop")
    assert refusal("0.0.0.0", "laptop:8642", "http://laptop:8642", "secret") == ""
    assert refusal("127.0.0.1", "laptop:8642") == "the Host is not this station"


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "http://localhost:1",
        "http://localhost.evil:8642",
        "http://x-localhost:8642",
        "https://localhost:1",
        "https://evil.example",
        "wss://localhost:8642",
        "http://[::1",
        "file://",
        "",
    ],
)
def test_a_page_of_another_origin_is_refused(origin: str) -> None:
    assert refusal("127.0.0.1", "localhost:8642", origin) == "the Origin is not this station"


@pytest.mark.parametrize("token", ["", "secre", "secrets", "SECRET", "s\xe9cret"])
def test_elsewhere_only_the_token_lets_in(token: str) -> None:
    assert "the token is not this station's" in refusal(
        "0.0.0.0", "10.1.2.3:8642", "http://10.1.2.3:8642", token
    )
    assert refusal("0.0.0.0", "10.1.2.3:8642", "http://10.1.2.3:8642", "secret") == ""
    assert "Host" in refusal("0.0.0.0", "evil.example", "http://evil.example", "secret")


def test_a_token_is_new_each_time_and_only_where_others_reach_the_station() -> None:
    assert Guard.of("127.0.0.1").token == Guard.of("localhost").token == Guard.of("::1").token == ""
    first, second = Guard.of("0.0.0.0").token, Guard.of("0.0.0.0").token
    assert first != second
    assert len(first) >= 32


def test_the_address_has_the_token_in_its_fragment_and_a_name_that_others_can_open() -> None:
    for bind, shown, fragment in (
        ("127.0.0.1", "localhost", ""),
        ("0.0.0.0", socket.gethostname(), "#token=secret"),
    ):
        with listening(bind, 0) as listener:
            address = address_of(listener, Guard(bind, "secret" if fragment else ""))
            assert address == f"http://{shown}:{listener.getsockname()[1]}/{fragment}"
            taken = listener.getsockname()[1]
            with pytest.raises(UsageError, match="choose another port, or 0"), listening(bind, taken):
                pass


def test_the_token_comes_as_a_subprotocol() -> None:
    assert token_of(["canine", "token.abc"]) == "abc"
    assert token_of(["canine"]) == token_of([]) == ""

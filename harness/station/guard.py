"""Who may come in over the network: by Host, Origin and token.

A page of another site, open in the same browser, can reach this machine's ports too: so a request's Origin
must be the station's own. A name that somebody points at this machine (DNS rebinding) would be such an
Origin: so the Host must be an address, or a name that is known to be this machine's.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

from harness.addresses import is_local

SUBPROTOCOL = "canine"
TOKEN_PREFIX = "token."  # of the subprotocol that carries the token: browsers send no headers of ours
TOKEN_BYTES = 24


@dataclass(frozen=True)
class Guard:
    """Lets requests in, or says why not.

    Attributes:
        bind: the address that is listened on.
        token: what a request must have; "" for none, on this machine alone.
    """

    bind: str
    token: str

    @classmethod
    def of(cls, bind: str) -> Guard:
        """The guard of an address, with a token that nobody foresees if others reach it."""
        return cls(bind, "" if is_local(bind) else secrets.token_urlsafe(TOKEN_BYTES))

    def refusal_of_host(self, headers: Mapping[str, str]) -> str:
        """Why a request is refused; "" if it is not."""
        host = headers.get("host", "")
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            name = ""
        return "" if self._is_ours(name) else "the Host is not this station"

    def _is_ours(self, name: str) -> bool:
        if name in ("localhost", self.bind.lower()):
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            own = socket.gethostname().lower()
            return not is_local(self.bind) and name in (own, f"{own}.local", socket.getfqdn().lower())
        return address.is_loopback if is_local(self.bind) else True

    def refusal(self, headers: Mapping[str, str], token: str) -> str:
        """Why a request that may change something is refused; "" if it is not."""
        if why := self.refusal_of_host(headers):
            return why
        host = headers.get("host", "")
        if headers.get("origin") not in (None, f"http://{host}", f"https://{host}"):  # a proxy may add TLS
            return "the Origin is not this station"
        if self.token and not hmac.compare_digest(token.encode(), self.token.encode()):
            return "the token is not this station's: take the whole address that it printed"
        return ""


def token_of(subprotocols: Sequence[str]) -> str:
    """The token among a socket's subprotocols; "" if there is none."""
    carried = (name for name in subprotocols if name.startswith(TOKEN_PREFIX))
    return next(carried, "").removeprefix(TOKEN_PREFIX)

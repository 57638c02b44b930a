"""Addresses of this machine."""

from __future__ import annotations

import ipaddress

LOCALHOST = "127.0.0.1"


def is_local(host: str) -> bool:
    """Does nobody but this machine reach an address?"""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"

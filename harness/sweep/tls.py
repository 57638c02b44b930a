"""TLS to a Dask cluster: the certificates by which this machine and the cluster know each other."""

from __future__ import annotations

import ssl
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.addresses import is_local
from models.errors import UsageError


@dataclass(frozen=True)
class Certificates:
    """Files in PEM format; what is None is taken from Dask's configuration (`distributed.comm.tls`).

    Attributes:
        ca: certificate of the authority that signed those of scheduler, workers and this machine.
        cert: this machine's certificate.
        key: its private key, without passphrase; None also if it stands in `cert`.
    """

    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None

    @property
    def options(self) -> dict[str, Path]:
        """Those given, by the option of `canine sweep`."""
        named = {"--dask-ca": self.ca, "--dask-cert": self.cert, "--dask-key": self.key}
        return {option: path for option, path in named.items() if path is not None}


def check_use(address: str | None, certificates: Certificates) -> None:
    """Check that certificates are given for an encrypted address.

    Raises:
        UsageError: they are not.
    """
    for option, path in certificates.options.items():
        if address is None:
            raise UsageError(f"{option} {path}: needs the cluster's address, --dask tls://host:8786")
        if not address.startswith("tls://"):
            bare = address.rpartition("://")[2]
            raise UsageError(f"{option} {path}: {address} is not encrypted; expected --dask tls://{bare}")


def security_of(address: str, certificates: Certificates) -> Any:
    """Dask's `Security` for an address; None if it is not encrypted.

    Raises:
        UsageError: a certificate is missing, cannot be read, or does not fit its key.
    """
    if not address.startswith("tls://"):
        return None
    from distributed.security import Security  # noqa: PLC0415 - it takes a second

    files = {"tls_ca_file": certificates.ca, "tls_client_cert": certificates.cert,
             "tls_client_key": certificates.key}  # fmt: skip
    security: Any = Security(
        require_encryption=True, **{name: str(path) for name, path in files.items() if path is not None}
    )  # type: ignore[no-untyped-call]
    ca, cert, key = security.tls_ca_file, security.tls_client_cert, security.tls_client_key
    for option, what, path in (("--dask-ca", "the authority", ca), ("--dask-cert", "this machine", cert)):
        if not path:
            raise UsageError(
                f"--dask {address}: needs the certificate of {what}; expected {option} FILE, or Dask's "
                "configuration distributed.comm.tls"
            )
    _check(replace(certificates, ca=Path(ca), cert=Path(cert), key=Path(key) if key else None))
    return security


def _check(certificates: Certificates) -> None:
    """Read the files once: Dask's own errors name none of them, and it would ask for a passphrase."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    for option, path in certificates.options.items():
        try:
            path.read_bytes()
        except OSError as reason:
            raise UsageError(
                f"{option} {path}: cannot be read ({reason.strerror or reason}); expected a PEM file"
            ) from None
    try:
        context.load_verify_locations(certificates.ca)
    except ssl.SSLError:
        raise UsageError(
            f"--dask-ca {certificates.ca}: has no certificate; expected that of the authority, in PEM format"
        ) from None
    assert certificates.cert is not None
    key = certificates.key or certificates.cert
    try:
        context.load_cert_chain(certificates.cert, key, password=lambda: "")
    except ssl.SSLError:
        raise UsageError(
            f"--dask-cert {certificates.cert}: {key} has no key for it, or one with a passphrase; expected "
            "this machine's certificate and its private key without passphrase, in PEM format"
        ) from None


def refusal(reason: BaseException) -> str:
    """What TLS found wrong with the other side, of an error and its causes; "" if nothing."""
    cause: BaseException | None = reason
    while cause is not None and not isinstance(cause, ssl.SSLError):
        cause = cause.__cause__ or cause.__context__
    return f"TLS: {cause.reason or cause}" if isinstance(cause, ssl.SSLError) else ""


def open_note(address: str) -> str:
    """A note on a scheduler that others can reach without a certificate; "" if it is encrypted, or here."""
    scheme, _, rest = address.rpartition("://")
    host = rest.rpartition(":")[0].strip("[]")
    if scheme not in ("", "tcp") or is_local(host):
        return ""
    return (
        f"{address}: is open, so whoever reaches this scheduler runs programs as you, there and here; "
        f"expected a network of your own, or tls://{rest}"
    )

"""A sweep on a Dask cluster that is reached by TLS alone; what is said of certificates and open clusters."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import dask
import pytest

from harness.sweep import chunks, sweep
from harness.sweep.sweep import plan_sweep
from harness.sweep.tls import Certificates, check_use, open_note, security_of
from models.errors import UsageError
from tests.codegen.firmware.test_c_quality import need
from tests.harness.command import canine
from tests.harness.sweep.test_cluster import PATIENCE_S, Cluster, wait_until

ADDRESS = "tls://127.0.0.1:8786"


def make_certificate(folder: Path, name: str, *options: str) -> Certificates:
    """A certificate that is its own authority."""
    cert, key = folder / f"{name}.pem", folder / f"{name}.key"
    command = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:P-256",
        "-days",
        "2",
    ]
    command += [*(options or ("-nodes",)), "-subj", f"/CN={name}", "-keyout", str(key), "-out", str(cert)]
    subprocess.run(command, check=True, capture_output=True)
    return Certificates(cert, cert, key)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with certificates: canine, stranger, secret (whose key has a passphrase)."""
    need("openssl", "openssl")
    folder = tmp_path_factory.mktemp("certificates")
    make_certificate(folder, "canine")
    make_certificate(folder, "stranger")
    make_certificate(folder, "secret", "-passout", "pass:word")
    (folder / "empty.pem").write_text("")
    return folder


@pytest.fixture(scope="module")
def cluster(folder: Path) -> Iterator[Cluster]:
    """A scheduler and a worker that know the certificate `canine`."""
    cert, key = folder / "canine.pem", folder / "canine.key"
    with ExitStack() as stack:
        made = Cluster(
            folder, stack, "--tls-ca-file", str(cert), "--tls-cert", str(cert), "--tls-key", str(key)
        )
        made.worker()
        wait_until(lambda: "Registered to" in (folder / "dask_worker.log").read_text())
        yield made


def of(folder: Path, name: str) -> Certificates:
    return Certificates(folder / f"{name}.pem", folder / f"{name}.pem", folder / f"{name}.key")


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "ANSWER_S", PATIENCE_S)
    monkeypatch.setattr(chunks, "ALONE_S", PATIENCE_S)


def test_a_sweep_over_tls_has_the_results_of_this_machine(
    cluster: Cluster, folder: Path, tmp_path: Path
) -> None:
    assert cluster.address.startswith("tls://")
    planned, notes = plan_sweep("two", thresholds="30:31", trials=100), list[str]()
    sweep.run(planned, tmp_path / "here")
    sweep.run(
        planned, tmp_path / "there", cluster.address, certificates=of(folder, "canine"), note=notes.append
    )
    assert (tmp_path / "there/sweep.csv").read_bytes() == (tmp_path / "here/sweep.csv").read_bytes()
    assert notes == []


def test_a_cluster_by_tls_refuses_strangers_and_those_without_tls(
    cluster: Cluster, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(chunks, "ANSWER_S", 3.0)
    planned = plan_sweep("two", trials=10)
    with pytest.raises(UsageError, match=r"no Dask scheduler answers there .*CERTIFICATE_VERIFY_FAILED"):
        sweep.run(planned, tmp_path, cluster.address, certificates=of(folder, "stranger"))
    with pytest.raises(UsageError, match="no Dask scheduler answers there"):
        sweep.run(planned, tmp_path, cluster.address.replace("tls://", "tcp://"))


def test_what_is_wrong_with_a_certificate_is_said(folder: Path) -> None:
    good = of(folder, "canine")
    ca, cert, key = good.ca, good.cert, good.key
    for certificates, message in (
        (Certificates(), "needs the certificate of the authority; expected --dask-ca FILE"),
        (Certificates(ca), "needs the certificate of this machine; expected --dask-cert FILE"),
        (Certificates(folder / "no.pem", cert, key), r"--dask-ca .*no.pem: cannot be read \(No such file"),
        (Certificates(ca, folder, key), r"--dask-cert .*: cannot be read \(Is a directory"),
        (Certificates(folder / "empty.pem", cert, key), "empty.pem: has no certificate; expected that"),
        (Certificates(ca, cert), r"--dask-cert .*canine.pem: .*canine.pem has no key for it"),
        (Certificates(ca, cert, folder / "stranger.key"), "stranger.key has no key for it, or one with"),
        (of(folder, "secret"), "secret.key has no key for it, or one with a passphrase"),
    ):
        with pytest.raises(UsageError, match=message):
            security_of(ADDRESS, certificates)
    # a key may stand behind its certificate
    both = folder / "both.pem"
    both.write_text((folder / "canine.pem").read_text() + (folder / "canine.key").read_text())
    assert security_of(ADDRESS, Certificates(ca, both)).require_encryption
    assert security_of("tcp://127.0.0.1:8786", Certificates()) is None


def test_certificates_in_dasks_own_configuration_are_taken(folder: Path) -> None:
    own = {"ca-file": str(folder / "canine.pem"), "client": {"cert": str(folder / "canine.pem"),
                                                            "key": str(folder / "canine.key")}}  # fmt: skip
    with dask.config.set({"distributed.comm.tls": dask.config.get("distributed.comm.tls") | own}):
        assert security_of(ADDRESS, Certificates()).tls_client_key == str(folder / "canine.key")


def test_certificates_without_an_encrypted_address_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(
        UsageError, match=r"--dask-ca .*: tcp://h:8786 is not encrypted; expected --dask tls://h"
    ):
        check_use("tcp://h:8786", of(folder, "canine"))
    with pytest.raises(UsageError, match=r"--dask-key a.key: needs the cluster's address, --dask tls://host"):
        check_use(None, Certificates(key=Path("a.key")))
    status, _, error = canine(capsys, "sweep", "two", "--dask-ca", folder / "canine.pem")
    assert status == 2
    assert "needs the cluster's address" in " ".join(error.split())


@pytest.mark.parametrize(
    ("address", "is_open"),
    [
        ("tcp://localhost:8786", False),
        ("127.0.0.1:8786", False),
        ("tcp://[::1]:8786", False),
        ("tls://far:8786", False),
        ("tcp://far:8786", True),
        ("10.0.0.7:8786", True),
        ("tcp://[fe80::1%eth0]:1", True),
    ],
)
def test_a_scheduler_that_others_may_reach_is_noted(address: str, is_open: bool) -> None:
    assert ("whoever reaches this scheduler runs programs as you" in open_note(address)) is is_open

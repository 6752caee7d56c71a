"""Connections to a scheduler: which addresses are allowed, encryption, and how a failure is reported.

A process that reaches a port of dask can run programs there, as dask unpickles what it is sent. Beyond loopback each
address must therefore be ``tls://``, where both ends show a certificate; certificates are named in dask's own
configuration.
"""

from __future__ import annotations

import copy
import ipaddress
import logging
import os
import re
import socket
import ssl
import warnings
from collections.abc import Iterable
from typing import Any, Protocol
from urllib.parse import urlsplit

from models.words.errors import SpallwatchError, WrongInputError


class ClusterError(SpallwatchError):
    """The scheduler or its workers are not reached, or not for too long; the message says which and how long."""


class RefusedWorkerError(WrongInputError):
    """A scheduler or workers cannot be used; the message names each, what was expected and what came."""


_NO_PAGES: dict[str, Any] = {
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # What pages would show: samples of the stack, which take 1.5 % of each worker's time.
    "distributed.worker.profile.enabled": False,
}


class Local:
    """A scheduler in this process and workers of one thread each, which share the memory of the machine.

    Threads of BLAS are one a worker (dask's own setting). Other users of this machine reach loopback too, and dask
    runs what it is sent: the ports ask for a certificate of this run, whose key is in the memory of its processes
    alone, and those of web pages serve none.
    """

    address = "local"
    lasting = False

    def __init__(self, workers: int) -> None:
        """Start the workers; 0 is one per core."""
        import distributed
        from dask import config
        from distributed.system import MEMORY_LIMIT

        self.workers = workers or os.cpu_count() or 1
        settings: Any = config
        security: Any = distributed.Security
        start: Any = distributed.LocalCluster
        self._security = security.temporary()
        with config.set(_NO_PAGES):
            self._cluster = start(
                n_workers=self.workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                security=self._security,
                # None would be port 8787 of all interfaces; of workers it is any port of loopback.
                dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
                memory_limit=MEMORY_LIMIT // self.workers,
                # A nanny refers to the settings of the process: a worker started again would have those of then.
                config=copy.deepcopy(settings.config),
                silence_logs=logging.CRITICAL,
                preload=["models.fleet.member"],
            )

    def connect(self) -> Any:
        """Return a new client of the scheduler."""
        return new_client(self._cluster.scheduler_address, self._security)

    def close(self) -> None:
        """End the workers and the scheduler."""
        self._cluster.close()


CONNECT_S = 15.0
"""Time for a connection to a scheduler, s."""
_CERTIFICATES = ("ca-file", "client.cert")


class Cluster(Protocol):
    """A scheduler that clients connect to.

    Attributes:
        address: for people.
        workers: at least so many are waited for.
        lasting: whether a scheduler that was lost may come back.
    """

    address: str
    workers: int
    lasting: bool

    def connect(self) -> Any:
        """Return a new ``distributed.Client``; ClusterError where no scheduler answers."""
        ...

    def close(self) -> None:
        """Stop what was started for this cluster."""
        ...


class Remote:
    """A scheduler that others started."""

    lasting = True

    def __init__(self, address: str, workers: int) -> None:
        """Check the address and the certificates.

        Raises:
            WrongInputError: the address is none, or not allowed, or a certificate is missing.
        """
        self.address = checked_address(address)
        self.workers = max(workers, 1)
        self._security = _security(self.address)

    def connect(self) -> Any:
        """Return a new client of the scheduler."""
        return new_client(self.address, self._security)

    def close(self) -> None:
        """Leave the scheduler running: it is not ours."""


def checked_address(address: str) -> str:
    """Return ``tcp://HOST:PORT`` of this machine or ``tls://HOST:PORT``.

    Raises:
        WrongInputError: for anything else.
    """
    expected = "expected tls://HOST:PORT, tcp://HOST:PORT of this machine, or local"
    try:
        split = urlsplit(address)
        host, port = split.hostname, split.port
    except ValueError:
        # Its words may hold a part of a password.
        raise WrongInputError(f"--cluster: {expected}") from None
    rest = split.path.strip("/") or split.query or split.fragment or split.username or split.password
    if split.scheme not in ("tcp", "tls") or not host or not port or rest:
        raise WrongInputError(f"--cluster: {expected}, got {_shown(address)!r}")
    if split.scheme == "tcp" and not is_loopback(host):
        raise WrongInputError(
            f"--cluster: tcp://{host}:{port} is another machine, and dask runs what it is sent: expected "
            f"tls://{host}:{port}, with certificates"
        )
    return f"{split.scheme}://[{host}]:{port}" if ":" in host else f"{split.scheme}://{host}:{port}"


def check_addresses(addresses: Iterable[str]) -> None:
    """Refuse workers that are reached without encryption on other machines.

    Raises:
        RefusedWorkerError: naming them.
    """
    open_ones = sorted(address for address in addresses if not _allowed(address))
    if open_ones:
        raise RefusedWorkerError(
            f"workers without encryption on other machines, expected tls://: {', '.join(open_ones)}"
        )


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine and not reached by others; False where its name is not known."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        pass
    try:
        found = socket.getaddrinfo(host, None)
    except OSError:
        return False
    return all(ipaddress.ip_address(str(entry[4][0]).partition("%")[0]).is_loopback for entry in found)


def new_client(address: str, security: Any) -> Any:
    """Return a client of a scheduler.

    Raises:
        ClusterError: naming the address and the cause.
    """
    import distributed
    from distributed.versions import VersionMismatchWarning

    # Lost workers and schedulers are reported by the executor, once; dask gives each of its loggers a level.
    for name in ("distributed", *(name for name in logging.root.manager.loggerDict if name.startswith("distributed."))):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with warnings.catch_warnings():
        # Versions are compared by name before anything is run.
        warnings.simplefilter("ignore", VersionMismatchWarning)
        try:
            return distributed.Client(
                address, timeout=CONNECT_S, set_as_default=False, security=security, name="spallwatch"
            )
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            raise ClusterError(f"no dask scheduler answers at {address}: {_cause(error)}") from None


def _security(address: str) -> Any:
    """Return the certificates of dask's configuration, None for tcp.

    Raises:
        WrongInputError: they are not named there, or cannot be read.
    """
    if address.startswith("tcp://"):
        return None
    import distributed
    from dask import config

    configuration: Any = config
    named = {name: configuration.get(f"distributed.comm.tls.{name}", None) for name in _CERTIFICATES}
    if missing := [name for name, path in named.items() if not path]:
        variables = " or ".join(f"DASK_DISTRIBUTED__COMM__TLS__{_variable(name)}" for name in missing)
        raise WrongInputError(
            f"--cluster {address}: expected certificates in dask's configuration, "
            f"distributed.comm.tls: {', '.join(missing)} (or {variables} in the environment)"
        )
    try:
        security: Any = distributed.Security(require_encryption=True)
        if security.get_connection_args("client").get("ssl_context") is None:
            raise ValueError("no certificate")
    except (OSError, ssl.SSLError, ValueError) as error:
        paths = ", ".join(f"{name} {path}" for name, path in named.items())
        raise WrongInputError(f"--cluster {address}: the certificates cannot be used ({paths}): {error}") from None
    return security


def _cause(error: BaseException) -> str:
    """Return why a connection failed, without the objects and classes that dask names."""
    text = " ".join(str(error.__cause__ or error).split())
    return re.sub(r"^(in <.*?>: )?(\w+: )?(\[Errno \d+\] )?", "", text) or type(error).__name__


def _variable(name: str) -> str:
    return name.upper().replace("-", "_").replace(".", "__")


def _allowed(address: str) -> bool:
    try:
        split = urlsplit(address)
        return split.scheme == "tls" or (split.hostname is not None and is_loopback(split.hostname))
    except ValueError:
        return False


def _shown(address: str) -> str:
    from models.work.redact import redact

    return redact(address)

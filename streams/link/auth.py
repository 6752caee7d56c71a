"""Proof that a sender has the key of its stream, and TLS: docs/reference/wire.md has the protocol.

The key itself is never sent: the sender answers a nonce of the receiver with a code over it.
"""

from __future__ import annotations

import hashlib
import hmac
import ssl
import stat
from pathlib import Path

from models.platform.portable import others_may
from streams.link.wire import HELLO_MAGIC
from streams.types.spec import SourceError

NONCE_BYTES = 32
"""Random bytes that the receiver answers to a hello of version 2."""
PROOF_BYTES = 32
"""Answer of the sender: HMAC-SHA256."""
MIN_KEY_CHARACTERS = 16
_MAX_KEY_BYTES = 4096


def read_key(path: Path, where: str) -> bytes:
    """Return the key in a file, its first line; ``where`` is the key or option named in a message.

    Raises:
        SourceError: the file cannot be read or its first line is empty; the key is not in the message.
    """
    try:
        with path.open("rb") as file:
            key = file.readline(_MAX_KEY_BYTES).strip()
    except OSError as error:
        raise SourceError(f"{where}: {path} cannot be read: {error.strerror or error}") from None
    if not key:
        raise SourceError(f"{where}: the first line of {path} is empty; expected the key")
    return key


def key_weakness(path: Path, key: bytes) -> str | None:
    """Return in one sentence why a key is weak, or None."""
    if len(key) < MIN_KEY_CHARACTERS:
        return f"the key in {path} has {len(key)} characters; make it at least {MIN_KEY_CHARACTERS}"
    if others_may(path.stat().st_mode, stat.S_IROTH | stat.S_IWOTH):
        return f"others may read or change {path}; make it safe with: chmod 600 {path}"
    return None


def proof(key: bytes, nonce: bytes, stream: str) -> bytes:
    """Return what a sender with the key answers to a nonce."""
    return hmac.new(key, HELLO_MAGIC + nonce + stream.encode(), hashlib.sha256).digest()


def is_proof(given: bytes, key: bytes, nonce: bytes, stream: str) -> bool:
    """Return whether an answer proves the key, in a time that does not depend on where it differs."""
    return hmac.compare_digest(given, proof(key, nonce, stream))


def receiver_context(cert_file: Path, key_file: Path, where: str) -> ssl.SSLContext:
    """Return the TLS settings of a receiver; SourceError where its files cannot be used."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(cert_file, key_file)
    except (OSError, ssl.SSLError) as error:
        raise SourceError(f"{where}: tls_cert_file, tls_key_file cannot be used: {error}") from None
    return context


def sender_context(ca_file: Path, where: str) -> ssl.SSLContext:
    """Return the TLS settings of a sender that trusts certificates of ``ca_file`` only; SourceError likewise."""
    try:
        return ssl.create_default_context(cafile=str(ca_file))
    except (OSError, ssl.SSLError) as error:
        raise SourceError(f"{where}: {ca_file} cannot be used: {error}") from None

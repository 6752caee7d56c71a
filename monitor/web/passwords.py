"""Hashes of passwords: Argon2id; those of scrypt that earlier versions stored are still checked."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from base64 import b64decode

MIN_PASSWORD_CHARACTERS, MAX_PASSWORD_CHARACTERS = 10, 200
_MEMORY_KIB, _PASSES, _LANES, _KEY_BYTES, _SALT_BYTES = 19_456, 2, 1, 32, 16
"""19 MB and some 50 ms a password: the least that OWASP's cheat sheet of password storage recommends."""
_PRESENT = f"$argon2id$v=19$m={_MEMORY_KIB},t={_PASSES},p={_LANES}$"
_ARGON2ID = re.compile(
    r"\$argon2id\$v=19\$m=(\d{1,7}),t=(\d{1,2}),p=(\d{1,2})\$[A-Za-z0-9+/]{11,86}\$[A-Za-z0-9+/]{43}"
)
_MAX_MEMORY_KIB, _MAX_N = 1 << 20, 1 << 20
_NOBODY = _PRESENT + "A" * 22 + "$" + "A" * 43


def check_new_password(password: str) -> str:
    """Return a password that may be set; raise ValueError where it is too short or too long."""
    if not MIN_PASSWORD_CHARACTERS <= len(password) <= MAX_PASSWORD_CHARACTERS:
        raise ValueError(f"a password has {MIN_PASSWORD_CHARACTERS} to {MAX_PASSWORD_CHARACTERS} characters")
    return password


def hash_password(password: str) -> str:
    """Return the Argon2id hash of a password, with its costs and a new salt, as a PHC string."""
    # Imported when it is first used, for most commands need no password.
    from cryptography.hazmat.primitives.kdf.argon2 import Argon2id

    salt = secrets.token_bytes(_SALT_BYTES)
    derived = Argon2id(salt=salt, length=_KEY_BYTES, iterations=_PASSES, lanes=_LANES, memory_cost=_MEMORY_KIB)
    return derived.derive_phc_encoded(_bytes_of(password))


def is_password(password: str, stored: str) -> bool:
    """Return whether a password is that of a hash; another hash, also "", takes as long and is that of none."""
    if stored.startswith("scrypt$"):
        known = _is_scrypt(password, stored)
        if known is not None:
            return known
    found = _ARGON2ID.fullmatch(stored)
    usable = found is not None and int(found[1]) <= _MAX_MEMORY_KIB and int(found[3]) > 0
    return _is_argon2id(password, stored if usable else _NOBODY) and usable


def is_present(stored: str) -> bool:
    """Return whether a hash is as new ones are; another one is replaced at the next sign-in."""
    return stored.startswith(_PRESENT)


def _is_argon2id(password: str, stored: str) -> bool:
    from cryptography.exceptions import InvalidKey
    from cryptography.hazmat.primitives.kdf.argon2 import Argon2id

    try:
        Argon2id.verify_phc_encoded(_bytes_of(password), stored)
    except (InvalidKey, ValueError):
        return False
    return True


def _is_scrypt(password: str, stored: str) -> bool | None:
    """Return whether a password is that of ``scrypt$N$R$P$SALT$KEY``; None where this is no such hash."""
    try:
        _, *costs, salt, key = stored.split("$")
        n, r, p = (int(cost) for cost in costs)
        given = (b64decode(salt, validate=True), b64decode(key, validate=True))
        if not (1 < n <= _MAX_N and 0 < r <= 32 and 0 < p <= 16):
            return None
        memory = 2 * 128 * n * r * p
        found = hashlib.scrypt(_bytes_of(password), salt=given[0], n=n, r=r, p=p, maxmem=memory, dklen=_KEY_BYTES)
    except ValueError:
        return None
    return hmac.compare_digest(found, given[1])


def _bytes_of(password: str) -> bytes:
    """Return what is hashed; of one that is too long, more than may be set, so that it fits none."""
    return password[: MAX_PASSWORD_CHARACTERS + 1].encode("utf-8", "surrogatepass")

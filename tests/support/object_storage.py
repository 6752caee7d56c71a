"""An object storage that speaks S3, on loopback: moto's server in a process of its own, which checks signatures.

Run as a program it serves until its standard input ends, so that it never outlives the tests.
"""

from __future__ import annotations

import calendar
import hashlib
import hmac
import importlib
import json
import logging
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import SplitResult, parse_qs, quote, urlsplit

import pytest

BUCKET = "archive"
_ALLOWED = {"Version": "2012-10-17", "Statement": [{"Effect": "Allow", "Action": "s3:*", "Resource": "*"}]}
_READING = {
    "Version": "2012-10-17",
    "Statement": [{"Effect": "Allow", "Action": ["s3:GetObject", "s3:ListBucket"], "Resource": "*"}],
}


@dataclass(frozen=True)
class ObjectStorage:
    """A running server.

    Attributes:
        endpoint: its URL.
        environment: variables of a user who may do everything; give them to a process or to ``monkeypatch``.
        reader: those of a user who may only read and list.
    """

    endpoint: str
    port: int
    environment: Mapping[str, str]
    reader: Mapping[str, str]

    def url(self, path: str = "") -> str:
        """Return the URL of a path in the bucket."""
        return f"s3://{BUCKET}/{path}"

    def presigned(self, path: str, expires_s: int = 3600) -> str:
        """Return the URL of an object with the owner's signature in its query."""
        from botocore.auth import S3SigV4QueryAuth
        from botocore.awsrequest import AWSRequest
        from botocore.credentials import Credentials

        user = self.environment
        key = Credentials(user["AWS_ACCESS_KEY_ID"], user["AWS_SECRET_ACCESS_KEY"])
        request = AWSRequest("GET", f"{self.endpoint}/{BUCKET}/{path}")
        S3SigV4QueryAuth(key, "s3", user["AWS_DEFAULT_REGION"], expires_s).add_auth(request)
        return str(request.url)

    def secrets(self) -> tuple[str, ...]:
        """Return what must stand in no log and no file."""
        names = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY")
        return tuple(user[name] for user in (self.environment, self.reader) for name in names)


@contextmanager
def object_storage(names_an_answer: int = 20) -> Iterator[ObjectStorage]:
    """Start a server with a bucket, which lists so many names at a time; it is ended with the block."""
    with subprocess.Popen(
        [sys.executable, str(Path(__file__))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONWARNINGS": "ignore", "MOTO_S3_DEFAULT_MAX_KEYS": str(names_an_answer)},
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            found = json.loads(process.stdout.readline())
            yield ObjectStorage(
                found["endpoint"],
                found["port"],
                _variables(found["endpoint"], found["owner"]),
                _variables(found["endpoint"], found["reader"]),
            )
        finally:
            process.stdin.close()
            process.kill()


def use_account(variables: Mapping[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let this process be a user; file systems that are open belong to another one."""
    for name in ("AWS_SESSION_TOKEN", "AWS_PROFILE", "AWS_MAX_ATTEMPTS"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    kind: Any = importlib.import_module("s3fs").S3FileSystem
    for files in list(kind._cache.values()):
        _close(files)
    kind.clear_instance_cache()


def _close(files: Any) -> None:
    """Close the connections of a file system, for which its finalizer takes a tenth of a second at most."""
    creator = getattr(files, "_s3creator", None)
    if creator is not None and not files.asynchronous:
        importlib.import_module("fsspec.asyn").sync(files.loop, creator.__aexit__, None, None, None, timeout=30.0)


def _variables(endpoint: str, key: Mapping[str, str]) -> dict[str, str]:
    return {
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ACCESS_KEY_ID": key["AccessKeyId"],
        "AWS_SECRET_ACCESS_KEY": key["SecretAccessKey"],
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_SHARED_CREDENTIALS_FILE": os.devnull,
        "AWS_CONFIG_FILE": os.devnull,
        "AWS_EC2_METADATA_DISABLED": "true",
        "NO_PROXY": "127.0.0.1",
        "no_proxy": "127.0.0.1",
    }


def _let_signed_queries_in() -> None:
    """Teach the server to check presigned URLs, of which it knows no check: signature and expiry, no rights."""
    from moto.s3.exceptions import S3AccessDeniedError, S3SignatureDoesNotMatchError
    from moto.s3.responses import S3Response

    by_header = S3Response._authenticate_and_authorize_s3_action

    def check(self: Any, bucket_name: str | None = None, key_name: str | None = None) -> None:
        url = urlsplit(self.uri)
        query = parse_qs(url.query)
        if "X-Amz-Signature" not in query or self.headers.get("Authorization"):
            by_header(self, bucket_name=bucket_name, key_name=key_name)
            return
        signed = calendar.timegm(time.strptime(query["X-Amz-Date"][0], "%Y%m%dT%H%M%SZ"))
        if time.time() > signed + int(query["X-Amz-Expires"][0]):
            raise S3AccessDeniedError
        if query["X-Amz-Signature"][0] != _query_signature(self.method, url, self.headers["Host"], _SECRETS):
            raise S3SignatureDoesNotMatchError

    S3Response._authenticate_and_authorize_s3_action = check


_SECRETS: dict[str, str] = {}
"""Secret keys by access key."""


def _query_signature(method: str, url: SplitResult, host: str, secrets: Mapping[str, str]) -> str:
    """Return the signature of a presigned URL (AWS Signature Version 4, query parameters)."""
    query = parse_qs(url.query)
    key, *scope = query["X-Amz-Credential"][0].split("/")
    pairs = sorted((name, values[0]) for name, values in query.items() if name != "X-Amz-Signature")
    canonical = "&".join(f"{quote(name, safe='-_.~')}={quote(value, safe='-_.~')}" for name, value in pairs)
    request = "\n".join((method, url.path, canonical, f"host:{host}", "", "host", "UNSIGNED-PAYLOAD"))
    hashed = hashlib.sha256(request.encode()).hexdigest()
    text = "\n".join(("AWS4-HMAC-SHA256", query["X-Amz-Date"][0], "/".join(scope), hashed))
    signing = f"AWS4{secrets.get(key, '')}".encode()
    for part in scope:
        signing = hmac.digest(signing, part.encode(), "sha256")
    return hmac.digest(signing, text.encode(), "sha256").hex()


def _serve() -> None:
    """Serve, with a bucket and two users; then say where, in one line of JSON."""
    import boto3
    from moto import settings
    from moto.server import ThreadedMotoServer

    logging.disable()
    _let_signed_queries_in()
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    port = server.get_host_and_port()[1]
    endpoint = f"http://127.0.0.1:{port}"
    account = {"aws_access_key_id": "first", "aws_secret_access_key": "first", "region_name": "us-east-1"}
    s3, iam = (boto3.client(name, endpoint_url=endpoint, **account) for name in ("s3", "iam"))
    s3.create_bucket(Bucket=BUCKET)
    keys = SimpleNamespace()
    for name, policy in (("owner", _ALLOWED), ("reader", _READING)):
        iam.create_user(UserName=name)
        iam.put_user_policy(UserName=name, PolicyName=name, PolicyDocument=json.dumps(policy))
        made = iam.create_access_key(UserName=name)["AccessKey"]
        _SECRETS[made["AccessKeyId"]] = made["SecretAccessKey"]
        setattr(keys, name, made)
    # From now on each request needs a valid signature and the right to do what it asks.
    settings.INITIAL_NO_AUTH_ACTION_COUNT = 0
    users = {name: {part: key[part] for part in ("AccessKeyId", "SecretAccessKey")} for name, key in vars(keys).items()}
    sys.stdout.write(json.dumps({"endpoint": endpoint, "port": port, **users}) + "\n")
    sys.stdout.flush()
    sys.stdin.read()


if __name__ == "__main__":
    _serve()

"""An object storage that speaks S3, on loopback: moto's server in a process of its own, which checks signatures.

Run as a program it serves until its standard input ends, so that it never outlives the tests.
"""

from __future__ import annotations

import importlib
import json
import logging
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

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

    def secrets(self) -> tuple[str, ...]:
        """Return what must stand in no log and no file."""
        names = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY")
        return tuple(user[name] for user in (self.environment, self.reader) for name in names)


@contextmanager
def object_storage() -> Iterator[ObjectStorage]:
    """Start a server with a bucket; it is ended with the block."""
    with subprocess.Popen(
        [sys.executable, str(Path(__file__))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONWARNINGS": "ignore"},
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
    importlib.import_module("s3fs").S3FileSystem.clear_instance_cache()


def _variables(endpoint: str, key: Mapping[str, str]) -> dict[str, str]:
    return {
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ACCESS_KEY_ID": key["AccessKeyId"],
        "AWS_SECRET_ACCESS_KEY": key["SecretAccessKey"],
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_SHARED_CREDENTIALS_FILE": os.devnull,
        "AWS_CONFIG_FILE": os.devnull,
        "AWS_EC2_METADATA_DISABLED": "true",
    }


def _serve() -> None:
    """Serve, with a bucket and two users; then say where, in one line of JSON."""
    import boto3
    from moto import settings
    from moto.server import ThreadedMotoServer

    logging.disable()
    os.environ["MOTO_S3_DEFAULT_MAX_KEYS"] = "20"
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
        setattr(keys, name, iam.create_access_key(UserName=name)["AccessKey"])
    # From now on each request needs a valid signature and the right to do what it asks.
    settings.INITIAL_NO_AUTH_ACTION_COUNT = 0
    users = {name: {part: key[part] for part in ("AccessKeyId", "SecretAccessKey")} for name, key in vars(keys).items()}
    sys.stdout.write(json.dumps({"endpoint": endpoint, "port": port, **users}) + "\n")
    sys.stdout.flush()
    sys.stdin.read()


if __name__ == "__main__":
    _serve()

"""Makers and checks that tests of page share."""

from __future__ import annotations

import json
import urllib.request
from typing import Any

from tests.support.waiting import PATIENCE_S


def ask(url: str, path: str, body: dict[str, Any] | None = None, token: str = "") -> dict[str, Any]:
    data = None if body is None else json.dumps(body).encode()
    headers = {"content-type": "application/json"} | ({"authorization": f"Bearer {token}"} if token else {})
    with urllib.request.urlopen(urllib.request.Request(f"{url}{path}", data, headers), timeout=PATIENCE_S) as answer:
        return json.loads(answer.read())


def machines(url: str) -> dict[str, dict[str, Any]]:
    return {machine["name"]: machine for machine in ask(url, "api/machines")["machines"]}

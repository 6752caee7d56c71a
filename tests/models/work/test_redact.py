"""Credentials are hidden wherever they stand in a text, and what is none is left as it is."""

from __future__ import annotations

import json
import sys
import types
from urllib.parse import quote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.work.redact import HIDDEN, has_user_info, redact, redacted_traceback

SECRET = "wJalrXUtnFEMI/K7MDENG+bPxRfiCYplanted"


@pytest.fixture(autouse=True)
def no_credentials(monkeypatch, tmp_path):
    for name in ("AWS_SHARED_CREDENTIALS_FILE", "AWS_CONFIG_FILE"):
        monkeypatch.setenv(name, str(tmp_path / "none"))
    for name in ("AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_ACCESS_KEY_ID"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("s3://name:a/b+c@bucket/x.wav: denied", "s3://***@bucket/x.wav: denied"),
        ("https://u@host/x, https://u:p@host:8443/x", "https://***@host/x, https://***@host:8443/x"),
        ("u:p@ss@x in https://u:p@ss@host/", "u:p@ss@x in https://***@host/"),
        (
            "x.wav?X-Amz-Date=20261123T000000Z&X-Amz-Signature=0f",
            "x.wav?X-Amz-Date=20261123T000000Z&X-Amz-Signature=***",
        ),
        ("https://a.blob/c?sv=2020&sig=a%3D&se=2026", "https://a.blob/c?sv=2020&sig=***&se=2026"),
        ("https://h/x?id=AbCdEfGh12345678AbCdEfGh12345678", "https://h/x?id=***"),
        ("{'secret': 'a', \"password\": \"b'c\"}", "{'secret': '***', \"password\": \"***\"}"),
        ("aws_secret_access_key = 'abc'", "aws_secret_access_key = '***'"),
        ("Authorization: Bearer a.b\nHost: h", "Authorization: ***\nHost: h"),
        ("Credential=AKIAxyz/2026/s3, Signature=0123456789abcdef", "Credential=***, Signature=***"),
        ("the key AKIAIOSFODNN7EXAMPLE does not exist", "the key *** does not exist"),
    ],
)
def test_credentials_are_hidden_by_their_place(text, expected):
    assert redact(text) == expected
    assert redact(expected) == expected


@pytest.mark.parametrize(
    "text",
    [
        "s3://bucket/fleet/2026-11-23T10:00:00.wav",
        "http://127.0.0.1:9000/bucket/a@b.wav",
        "https://host/x?file=press_3.wav&signal=5&start=2026-11-23",
        "machine.press: 3 tokens, key = 4; keyed by name",
        "rows of the map 17 to 24: ValueError: load_newton must be positive, got -1.0",
    ],
)
def test_what_is_no_credential_is_left(text):
    assert redact(text) == text


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("AWS_SECRET_ACCESS_KEY", SECRET),
        ("AZURE_STORAGE_CONNECTION_STRING", SECRET),
        ("MY_STORE_PASSWORD", SECRET),
        ("FSSPEC_S3_SECRET", SECRET),
        ("FSSPEC_S3", json.dumps({"client_kwargs": {"aws_secret_access_key": SECRET}})),
        ("FSSPEC_SFTP_USERNAME", SECRET),
    ],
)
@pytest.mark.parametrize("spelling", [str, quote, lambda text: quote(text, safe=""), json.dumps, repr])
def test_values_of_the_environment_are_hidden_in_every_spelling(name, value, spelling, monkeypatch):
    text = f"begin{spelling(SECRET)}end"
    assert redact(text) == text
    monkeypatch.setenv(name, value)
    assert redact(text).replace('"', "").replace("'", "") == f"begin{HIDDEN}end"


@pytest.mark.parametrize("variable", ["AWS_SHARED_CREDENTIALS_FILE", "AWS_CONFIG_FILE"])
def test_values_of_files_are_hidden(variable, monkeypatch, tmp_path):
    place = tmp_path / "file of aws"
    place.write_text(f"[default]\naws_access_key_id = someone\naws_secret_access_key = {SECRET}\nregion = nowhere-1\n")
    monkeypatch.setenv(variable, str(place))
    assert redact(f"{SECRET} of nowhere-1") == "*** of nowhere-1"
    # Configuration files of fsspec are read by fsspec itself.
    loaded = types.SimpleNamespace(conf={"abfs": {"account_key": "Abcdefgh==", "account_name": "spallwatch"}})
    monkeypatch.setitem(sys.modules, "fsspec.config", loaded)
    assert redact("Abcdefgh== of spallwatch") == "*** of spallwatch"


@pytest.mark.parametrize("name", ["AWS_SHARED_CREDENTIALS_FILE", "SSL_TOKEN_PATH", "HOME", "FSSPEC_S3_ENDPOINT_URL"])
def test_places_and_other_variables_are_left(name, monkeypatch):
    monkeypatch.setenv(name, "/some/place/of/mine")
    assert redact("/some/place/of/mine is missing") == "/some/place/of/mine is missing"


@given(st.text(), st.text(st.characters(codec="ascii"), min_size=8), st.text())
def test_a_planted_secret_never_passes(before, secret, after):
    with pytest.MonkeyPatch.context() as patch:
        try:
            patch.setenv("PLANTED_SECRET", secret)
        except ValueError:  # A null byte is in no environment.
            return
        if secret in HIDDEN * 4 or HIDDEN in secret:
            return
        found = redact(before + secret + after)
        assert secret not in found
        assert redact(found) == found


@pytest.mark.parametrize("text", ["x" * 50_000, "https://" * 4000, "?" * 50_000, "&key" * 10_000, "token" * 10_000])
def test_a_long_word_does_not_cost_its_square(text):
    # The square of these lengths would take minutes.
    assert redact(text) == text


def test_a_traceback_holds_no_credentials():
    def fails(url):
        raise OSError(f"{url} is not there")

    with pytest.raises(OSError, match="is not there") as caught:
        fails("s3://name:planted@bucket/x")
    text = redacted_traceback(caught.value)
    assert "planted@" not in text  # Not in the lines of source either.
    assert "OSError: s3://***@bucket/x is not there" in text


def test_user_info_is_told():
    assert has_user_info("s3://name:pass@bucket/x")
    assert not has_user_info("s3://bucket/a@b")

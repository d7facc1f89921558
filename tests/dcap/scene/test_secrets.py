"""Secrets of the environment do not appear in what people are shown."""

import pytest

from dcap.scene.secrets import HIDDEN, has_log_in, redacted, redacted_url, without_secrets


@pytest.mark.parametrize("name", ["ANTHROPIC_API_KEY", "PREFECT_API_AUTH_STRING", "PREFECT_SERVER_API_AUTH_STRING"])
def test_values_of_secret_variables_are_hidden(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys and log-ins, wherever they are quoted."""
    monkeypatch.setenv(name, "somebody:long-enough")
    assert redacted("401 for somebody:long-enough") == f"401 for {HIDDEN}"


def test_other_values_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """A variable that holds no secret hides nothing."""
    monkeypatch.setenv("DCAP_DATA", "/somewhere/else")
    assert redacted("not in /somewhere/else") == "not in /somewhere/else"


@pytest.mark.parametrize(
    ("url", "secret", "shown"),
    [
        ("http://team:a/of-ours@h:42/api", "a/of-ours", "http://***@h:42/api"),
        ("http://team:9/of-ours@h/api", "9/of-ours", "http://***@h/api"),
        ("http:/team:of-ours@h/api", "of-ours", "http:/***@h/api"),
        ("team:of-ours@h:42/api", "of-ours", "***@h:42/api"),
        ("http://team:of-ours?x@h/api", "of-ours?x", "http://***@h/api"),
        ("http//team:of-ours@h:42/api", "of-ours", "http//***@h:42/api"),
        ("//team:of-ours@h/api", "of-ours", "***@h/api"),
        ("http://to/ken-of-ours@h/api", "to/ken-of-ours", "http://***@h/api"),
        ("s3://AKIA/ours:of-ours@h/b", "of-ours", "s3://***@h/b"),
        ("s3://token@h/bucket?key=of-ours", "key=of-ours", "s3://***@h/bucket?***"),
    ],
)
def test_who_signs_in_is_hidden_however_the_address_is_written(url: str, secret: str, shown: str) -> None:
    """With slashes and marks in the password, and without a scheme; nor is the password left in a message."""
    assert redacted_url(url) == shown
    assert has_log_in(url)
    assert "of-ours" not in without_secrets(f"{url}: {secret} is refused", url)


@pytest.mark.parametrize("url", ["s3://bucket/user@example.com/x", "/data/me@home/store", "http://127.0.0.1:42/api"])
def test_a_path_signs_nobody_in(url: str) -> None:
    """Its name is what a person needs to see."""
    assert redacted_url(url) == url
    assert not has_log_in(url)

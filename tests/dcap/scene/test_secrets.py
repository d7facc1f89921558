"""Secrets of the environment do not appear in what people are shown."""

import pytest

from dcap.scene.secrets import HIDDEN, redacted


@pytest.mark.parametrize("name", ["ANTHROPIC_API_KEY", "PREFECT_API_AUTH_STRING", "PREFECT_SERVER_API_AUTH_STRING"])
def test_values_of_secret_variables_are_hidden(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys and log-ins, wherever they are quoted."""
    monkeypatch.setenv(name, "somebody:long-enough")
    assert redacted("401 for somebody:long-enough") == f"401 for {HIDDEN}"


def test_other_values_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """A variable that holds no secret hides nothing."""
    monkeypatch.setenv("DCAP_DATA", "/somewhere/else")
    assert redacted("not in /somewhere/else") == "not in /somewhere/else"

"""A stand-in for a server of chat completions on the loopback interface, with the same models as Anthropic's stand-in.

What comes is put into the form of the Messages API, given to the model, and the reply put back. It objects to what
strict mode documents as an error: a property that is not required, a default, something beside a reference.
"""

from typing import Any

from fake_api import Answer, Body, FakeApi, error


class FakeOpenAi(FakeApi):
    """The server; `asked` has the calls in the form of the Messages API, `raw` as they came."""

    def __init__(self, *answers: Any) -> None:
        self.raw: list[Body] = []
        super().__init__(*answers)

    @property
    def url(self) -> str:
        return f"{super().url}/v1"

    def post(self, path: str, body: Body) -> Answer:
        """What a POST returns."""
        if path != "/v1/chat/completions":
            return error(404, "not_found_error", f"no {path}")
        self.raw.append(body)
        if said := complaint(body):
            return error(400, "invalid_request_error", said)
        status, reply = self.message(as_messages(body))
        return (status, completion(reply)) if status == 200 else (status, reply)


def complaint(body: Body) -> str:
    """What a strict server would not take, empty if it would."""
    form = body["response_format"]
    if form["type"] != "json_schema" or form["json_schema"]["strict"] is not True:
        return "a strict json_schema is expected"
    if ("max_tokens" in body) is ("max_completion_tokens" in body):
        return "one limit of tokens is expected"
    if body["messages"][0]["role"] != "system":
        return "the system text comes first"
    return loose(form["json_schema"]["schema"])


def loose(schema: Any) -> str:
    """Where a schema is not strict."""
    if isinstance(schema, list):
        return next((said for one in schema if (said := loose(one))), "")
    if not isinstance(schema, dict):
        return ""
    if schema.get("type") == "object" and sorted(schema["required"]) != sorted(schema["properties"]):
        return f"required lacks a property of {sorted(schema['properties'])}"
    if "$ref" in schema and len(schema) > 1:
        return f"{schema['$ref']} has siblings"
    return loose(list(schema.values()))


def as_messages(body: Body) -> Body:
    """A call in the form of the Messages API."""
    system, *turns = body["messages"]
    return {
        "model": body["model"],
        "system": [{"type": "text", "text": system["content"]}],
        "messages": [{"role": turn["role"], "content": blocks(turn["content"])} for turn in turns],
        "output_config": {"format": {"schema": body["response_format"]["json_schema"]["schema"]}},
    }


def blocks(content: str | list[Body]) -> list[Body]:
    """Parts of a turn as blocks."""
    if isinstance(content, str):
        return [{"type": "text", "text": content}]
    return [one if one["type"] == "text" else image(one["image_url"]["url"]) for one in content]


def image(url: str) -> Body:
    """A data URL as a block."""
    head, _, data = url.partition(";base64,")
    return {"type": "image", "source": {"type": "base64", "media_type": head.removeprefix("data:"), "data": data}}


def completion(reply: Body) -> Body:
    """A message as a completion."""
    text = "".join(block.get("text", "") for block in reply["content"] if block["type"] == "text")
    ended = {"end_turn": "stop", "max_tokens": "length", "refusal": "content_filter"}[reply["stop_reason"]]
    cached = reply["usage"].get("cache_read_input_tokens", 0)
    usage = {
        "prompt_tokens": reply["usage"]["input_tokens"] + cached,
        "completion_tokens": reply["usage"]["output_tokens"],
        "prompt_tokens_details": {"cached_tokens": cached},
    }
    said = {"role": "assistant", "content": text or None}
    return {"id": "c", "object": "chat.completion", "choices": [{"index": 0, "message": said, "finish_reason": ended}],
            "usage": usage}  # fmt: skip

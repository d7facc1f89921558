"""A stand-in for a server of chat completions on the loopback interface, with the same models as Anthropic's stand-in.

What comes is put into the form of the Messages API, given to the model, and the reply put back. It refuses what the
real one refuses (api_rules.py).
"""

from typing import Any

from api_rules import Body, Call, openai_refusal
from fake_api import Answer, FakeApi


class FakeOpenAi(FakeApi):
    """The server; `asked` has the calls in the form of the Messages API, `raw` as they came."""

    def __init__(self, *answers: Any) -> None:
        self.raw: list[Body] = []
        super().__init__(*answers)

    @property
    def url(self) -> str:
        return f"{super().url}/v1"

    def post(self, call: Call) -> Answer:
        """What a POST returns."""
        if call.path != "/v1/chat/completions":
            return failure(404, f"Invalid URL (POST {call.path})")
        self.raw.append(call.body)
        if wrong := openai_refusal(call):
            return failure(400, wrong)
        status, reply = self.message(as_messages(call.body))
        return (status, completion(reply)) if status == 200 else failure(status, reply["error"]["message"])


def failure(status: int, text: str) -> Answer:
    """An error as this API gives it."""
    return status, {"error": {"message": text, "type": "invalid_request_error", "param": None, "code": None}}


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

"""A stand-in for Anthropic's API on the loopback interface: messages and batches, and a model that reads like our own.

It refuses what the real one refuses (api_rules.py). `answers` are given in turn, the last one for ever.
"""

import json
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from api_rules import Body, Call, anthropic_refusal
from pydantic import TypeAdapter

from dcap.evaluation.sampling.questions import SAMPLES
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol import fireplace, questions
from dcap.language.protocol.questions import Question

KEY = "sk-never-to-be-shown"
Answer = tuple[int, Body]
ASKED = (*vars(questions).values(), *vars(fireplace).values(), SAMPLES)
QUESTIONS: dict[str, Question[Any, Any]] = {one.name: one for one in ASKED if isinstance(one, Question)}
HEADERS = {"anthropic-version": "2023-06-01", "x-api-key": KEY}
"""Of a question of a batch: those of the batch were looked at when it came."""


class FakeApi:
    """The server; what it was asked is in `asked`, in order of arrival."""

    def __init__(self, *answers: Callable[[Body], Answer], polls: int = 1) -> None:
        self.answers = list(answers) or [offline_model]
        self.asked: list[Body] = []
        self.headers: list[dict[str, str]] = []
        self.batches: dict[str, list[Body]] = {}
        self.polls = polls
        """How often a batch is looked at before it has ended."""
        self.looked: dict[str, int] = {}
        self.guard = threading.Lock()
        self.server = ThreadingHTTPServer(("127.0.0.1", 0), handler_of(self))
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True)
        self.thread.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.server_address[1]}"

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()

    def message(self, body: Body) -> Answer:
        """The reply to one call."""
        with self.guard:
            self.asked.append(body)
            make = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        return make(body)

    def checked(self, body: Body) -> Answer:
        """The reply to a question of a batch."""
        wrong = anthropic_refusal(Call(body, headers=HEADERS))
        return error(400, "invalid_request_error", wrong) if wrong else self.message(body)

    def post(self, call: Call) -> Answer:
        """What a POST returns."""
        path, body = call.path, call.body
        if wrong := anthropic_refusal(call):
            return error(400, "invalid_request_error", wrong)
        if path == "/v1/messages":
            return self.message(body)
        name = f"msgbatch_{len(self.batches)}"
        self.batches[name] = body["requests"]
        return 200, self.batch(name)

    def get(self, path: str) -> tuple[int, Body | str]:
        """What a GET returns."""
        words = path.removeprefix("/v1/messages/batches/").split("/")
        if words[0] not in self.batches:
            return error(404, "not_found_error", "no such batch")
        if words[1:] == ["results"]:
            return 200, "\n".join(json.dumps(self.result(one)) for one in self.batches[words[0]])
        self.looked[words[0]] = self.looked.get(words[0], 0) + 1
        return 200, self.batch(words[0])

    def batch(self, name: str) -> Body:
        """The state of a batch."""
        ended = self.looked.get(name, 0) >= self.polls
        now = datetime.now(UTC).isoformat()
        counts = dict.fromkeys(("canceled", "errored", "expired", "processing", "succeeded"), 0)
        return {
            "id": name, "type": "message_batch", "processing_status": "ended" if ended else "in_progress",
            "request_counts": counts, "created_at": now, "expires_at": now, "ended_at": now if ended else None,
            "results_url": f"{self.url}/v1/messages/batches/{name}/results" if ended else None,
        }  # fmt: skip

    def result(self, request: Body) -> Body:
        """The result of one question of a batch."""
        status, reply = self.checked(request["params"])
        if status == 200:
            return {"custom_id": request["custom_id"], "result": {"type": "succeeded", "message": reply}}
        if status == 410:
            return {"custom_id": request["custom_id"], "result": {"type": "expired"}}
        return {"custom_id": request["custom_id"], "result": {"type": "errored", "error": reply}}


def handler_of(api: FakeApi) -> type[BaseHTTPRequestHandler]:
    """What serves one connection."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            headers = {name.lower(): value for name, value in self.headers.items()}
            api.headers.append(headers)
            data = self.rfile.read(int(headers["content-length"]))
            self.reply(*api.post(Call(json.loads(data), self.path.split("?")[0], headers, len(data))))

        def do_GET(self) -> None:
            self.reply(*api.get(self.path.split("?")[0]))

        def reply(self, status: int, body: Body | str) -> None:
            data = (body if isinstance(body, str) else json.dumps(body)).encode()
            self.send_response(status)
            self.send_header("content-type", "application/json")
            self.send_header("retry-after-ms", "1")
            self.send_header("content-length", str(len(data)))
            self.end_headers()
            with suppress(ConnectionError):  # a client that waits no longer
                self.wfile.write(data)

        def log_message(self, *_: object) -> None:
            """Quiet."""

    return Handler


def message(text: str, stop: str = "end_turn", **usage: int) -> Answer:
    """A reply that says `text` after a thought."""
    content = [{"type": "thinking", "thinking": "", "signature": "c2ln"}, {"type": "text", "text": text}]
    tokens = {"input_tokens": 1000, "output_tokens": 100} | usage
    common = {"id": "msg_1", "type": "message", "role": "assistant", "model": "m", "stop_sequence": None}
    return 200, {**common, "content": content, "stop_reason": stop, "usage": tokens}


def says(value: object, stop: str = "end_turn", **usage: int) -> Callable[[Body], Answer]:
    """A model that answers with this value."""
    text = value if isinstance(value, str) else json.dumps(value)
    return lambda _: message(text, stop, **usage)


def fails(status: int, kind: str) -> Callable[[Body], Answer]:
    """A server that fails."""
    return lambda _: error(status, kind, f"the server says {kind}")


def error(status: int, kind: str, text: str) -> Answer:
    """An error as the API gives it."""
    return status, {"type": "error", "error": {"type": kind, "message": text}}


def data_of(body: Body) -> Body:
    """The data that a call brings, its blocks together."""
    found: Body = {}
    for block in body["messages"][0]["content"]:
        if block["type"] == "text" and "<data>" in block["text"]:
            found |= json.loads(block["text"].split("<data>")[1].split("</data>")[0])
    return found


def reason_of(body: Body) -> str:
    """Why the last answer could not be used, as a follow-up says it."""
    text = body["messages"][-1]["content"][0]["text"]
    return str(json.loads(text.split("<data>")[1].split("</data>")[0]))


def question_of(body: Body) -> str:
    """The name of the question."""
    return str(body["messages"][0]["content"][-1]["text"]).split()[1]


def offline_model(body: Body) -> Answer:
    """Reads the call's data and answers as the offline reader would."""
    question: Question[Any, Any] = QUESTIONS[question_of(body)]
    request = TypeAdapter(question.request).validate_python(data_of(body))
    return message(OfflineClient().ask(question, request).model_dump_json())


def self_willed(**changes: Mapping[str, object] | Callable[[Body], Body]) -> Callable[[Body], Answer]:
    """A model that differs from the offline reader: by question, the fields it answers otherwise, or how it does."""

    def model(body: Body) -> Answer:
        _, reply = offline_model(body)
        good = json.loads(reply["content"][-1]["text"])
        change = changes.get(question_of(body), {})
        return message(json.dumps(change(good) if callable(change) else good | dict(change)))

    return model

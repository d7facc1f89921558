"""Requests and spending of a run: a line of JSON per reply, and a budget that limits further questions.

Before a question is asked, its maximum cost is reserved; if that exceeds the rest of the budget, BudgetError is raised.
The actual cost replaces the reservation when the reply arrives. A call that is lost remains reserved at its maximum for
the lifetime of the run; reservations of a killed run are released, though such calls may be charged, and so may an
attempt that timed out before a successful one. Threads and processes of one machine share a ledger.
"""

import csv
import fcntl
import json
import os
import uuid
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import IO, TypeAlias

from dcap.language.model.reply_folder import Message
from dcap.scene.errors import BudgetError, InputError
from dcap.scene.written_files import object_to_json

PRICES = Path(__file__).with_name("prices.csv")
MILLION = 1e6
BATCH_FACTOR = 0.5
"""Price of a token in a batch over its normal price: the API's discount."""


@dataclass(frozen=True, slots=True)
class Price:
    """Prices of a model [USD per million tokens]."""

    input: float
    output: float
    cache_write: float
    cache_read: float


@dataclass(frozen=True, slots=True)
class Usage:
    """Tokens of one reply."""

    input_tokens: int = 0
    """Tokens neither written to nor read from the cache."""
    output_tokens: int = 0
    cache_write_tokens: int = 0
    cache_read_tokens: int = 0

    @classmethod
    def of(cls, message: Message) -> "Usage":
        """The token counts stated in a reply."""
        told = message.get("usage") or {}
        names = ("input_tokens", "output_tokens", "cache_creation_input_tokens", "cache_read_input_tokens")
        return cls(*(int(told.get(name) or 0) for name in names))

    def cost(self, price: Price) -> float:
        """Cost of the tokens [USD]."""
        spent = self.input_tokens * price.input + self.output_tokens * price.output
        cached = self.cache_write_tokens * price.cache_write + self.cache_read_tokens * price.cache_read
        return (spent + cached) / MILLION


@cache
def prices() -> Mapping[str, Price]:
    """Prices by model."""
    with PRICES.open(newline="", encoding="utf-8") as text:
        return {
            row["model"]: Price(*(float(row[name]) for name in ("input", "output", "cache_write", "cache_read")))
            for row in csv.DictReader(text)
        }


def price_of(model: str) -> Price | None:
    """Price of a model; None if it is unknown."""
    return prices().get(model)


def check_budget(model: str, max_cost: float | None) -> None:
    """Raise InputError if a budget cannot be enforced for a model."""
    if max_cost is not None and not 0 < max_cost < float("inf"):
        raise InputError(f"--max-cost {max_cost} is not a positive number of US dollars")
    if max_cost is not None and price_of(model) is None:
        raise InputError(f"--max-cost: the price of {model} is not known; add a row to {PRICES}")


def most(text_bytes: int, price: Price, max_tokens: int) -> float:
    """Upper bound of the cost of a call [USD]: every byte counts as a token written to the cache, with the longest
    answer."""
    return (text_bytes * price.cache_write + max_tokens * price.output) / MILLION


@dataclass(frozen=True, slots=True)
class ReservationLine:
    """A call in progress."""

    reserved: str
    """Name of the reservation."""
    process: int
    """Id of the asking process."""
    usd: float
    """Maximum cost of the call [USD]."""


@dataclass(frozen=True, slots=True)
class ReleaseLine:
    """A call that did not take place."""

    settles: str
    """Name of its reservation."""
    usd: float
    """Cost of the call: zero [USD]."""


@dataclass(frozen=True, slots=True)
class ReplyLine:
    """A reply and its cost."""

    settles: str
    """Name of its reservation; empty if the reply was already stored."""
    sample: str
    """Id of the sample that needed the reply."""
    question: str
    model: str
    how: str
    """Source of the reply: asked, batch or kept."""
    input_tokens: int
    output_tokens: int
    cache_write_tokens: int
    cache_read_tokens: int
    usd: float | None
    """Cost of the reply [USD]; None if the model's price is unknown."""
    digest: str = ""
    """Digest of the question, under which the reply is stored; empty in ledgers of earlier versions."""


LedgerLine: TypeAlias = ReservationLine | ReleaseLine | ReplyLine
"""A line of the ledger."""


@dataclass(frozen=True, slots=True)
class Spending:
    """Totals of a run; tokens and cost are those of new replies only."""

    models: tuple[str, ...]
    """Names of the models, in alphabetical order."""
    asked: int
    """Number of replies asked for one at a time."""
    batch: int
    """Number of replies asked for in batches."""
    kept: int
    """Number of replies that were already stored."""
    input_tokens: int
    """Tokens neither written to nor read from the cache."""
    output_tokens: int
    cache_write_tokens: int
    cache_read_tokens: int
    usd: float | None
    """Cost [USD]; None if the price of a model is unknown."""


@dataclass(frozen=True, slots=True)
class Ledger:
    """The lines of one run."""

    path: Path | None
    """File of the ledger; None: nothing is written, and there is no budget."""
    max_cost: float | None = None
    sample: str = ""

    def reserve(self, model: str, question: str, size: int, max_tokens: int, factor: float = 1.0) -> str:
        """Reserve the maximum cost of a call of this size, and return the name of the reservation; raises BudgetError
        if it exceeds the rest of the budget."""
        name = uuid.uuid4().hex[:12]
        if self.path is None or self.max_cost is None:
            return name
        check_budget(model, self.max_cost)
        price = prices()[model]
        needed = factor * most(size, price, max_tokens)
        with locked(self.path) as file:
            taken = sum(cost_by_reservation(file).values())
            if taken + needed > self.max_cost:
                raise BudgetError(
                    f"--max-cost {self.max_cost:g} USD: {taken:.4f} USD are spent or reserved, and the question "
                    f"{question!r} may cost up to {needed:.4f}; raise --max-cost to continue"
                )
            append(file, ReservationLine(name, os.getpid(), needed))
        return name

    def release(self, name: str) -> None:
        """Record that the call did not take place."""
        if self.path is not None and self.max_cost is not None:
            with locked(self.path) as file:
                append(file, ReleaseLine(name, 0.0))

    def settle(
        self,
        name: str,
        model: str,
        question: str,
        message: Message,
        *,
        how: str,
        factor: float = 1.0,
        sample: str = "",
        digest: str = "",
    ) -> None:
        """Record the cost of a reply; `how` is asked, batch or kept."""
        if self.path is None:
            return
        usage, price = Usage.of(message), price_of(model)
        cost = 0.0 if how == "kept" else factor * usage.cost(price) if price else None
        with locked(self.path) as file:
            whose = sample or self.sample
            append(file, ReplyLine(name, whose, question, model, how, **asdict(usage), usd=cost, digest=digest))


def spending_of(path: Path) -> Spending:
    """Replies, tokens and cost of a run."""
    replies = [line for line in read_lines(path) if isinstance(line, ReplyLine)]
    paid = [one for one in replies if one.how != "kept"]
    count = Counter(one.how for one in replies)
    return Spending(
        models=tuple(sorted({one.model for one in replies})),
        asked=count["asked"],
        batch=count["batch"],
        kept=count["kept"],
        input_tokens=sum(one.input_tokens for one in paid),
        output_tokens=sum(one.output_tokens for one in paid),
        cache_write_tokens=sum(one.cache_write_tokens for one in paid),
        cache_read_tokens=sum(one.cache_read_tokens for one in paid),
        usd=total_cost(paid),
    )


def total_cost(replies: Sequence[ReplyLine]) -> float | None:
    """Cost of replies [USD]; None if the price of a model is unknown."""
    known = [one.usd for one in replies if one.usd is not None]
    return round(sum(known, 0.0), 6) if len(known) == len(replies) else None


def in_words(total: Spending) -> str:
    """Totals as text for a person."""
    cost = "at an unknown price" if total.usd is None else f"{total.usd:.4f} USD"
    read = total.input_tokens + total.cache_write_tokens + total.cache_read_tokens
    return (
        f"{total.asked + total.batch} replies asked for, {total.kept} kept from before; {read} tokens in "
        f"({total.cache_read_tokens} from the cache), {total.output_tokens} out, {cost}"
    )


def read_lines(path: Path) -> list[LedgerLine]:
    """All lines; empty if there is no ledger."""
    return [read_line(text) for text in path.read_text(encoding="utf-8").splitlines()] if path.is_file() else []


def read_line(text: str) -> LedgerLine:
    """One line, of the kind determined by its keys."""
    tree = json.loads(text)
    kind: type[LedgerLine] = ReservationLine if "reserved" in tree else ReplyLine if "how" in tree else ReleaseLine
    return kind(**{one.name: tree[one.name] for one in fields(kind) if one.name in tree})


@contextmanager
def locked(path: Path) -> Iterator[IO[str]]:
    """The ledger, opened and locked."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield file


def append(file: IO[str], line: LedgerLine) -> None:
    """Append one line immediately."""
    file.write(json.dumps(object_to_json(line)) + "\n")
    file.flush()


def cost_by_reservation(file: IO[str]) -> dict[str, float]:
    """Cost by reservation [USD]: the reserved amount until it is settled, then the actual cost; reservations of
    processes that no longer exist are released."""
    file.seek(0)
    cost: dict[str, float] = {}
    for line in map(read_line, file):
        if isinstance(line, ReservationLine):
            cost[line.reserved] = line.usd if line.process == os.getpid() or is_alive(line.process) else 0.0
        else:
            cost[line.settles] = line.usd or 0.0
    return cost


def is_alive(process: int) -> bool:
    """Return whether a process of this machine runs."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True

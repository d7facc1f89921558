"""Requests and spending of a run: a line of JSON per reply, and a budget beyond which nothing is asked.

Before a question is asked, the most that it can cost is set aside; if that does not fit into what is left,
BudgetError. When the reply is there, the line of its true cost takes its place. A call that is lost on the way stays
counted at its most as long as the run lives; what a killed run had under way is free again, though it may be charged,
and so may an attempt that timed out before one that succeeded. Threads and processes of one machine share a ledger.
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
from dcap.scene.json_tree import object_to_json

PRICES = Path(__file__).with_name("prices.csv")
MILLION = 1e6
BATCH_FACTOR = 0.5
"""Price of a token in a batch over its usual price: the API's discount."""


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
    """Neither written to nor read from the cache."""
    output_tokens: int = 0
    cache_write_tokens: int = 0
    cache_read_tokens: int = 0

    @classmethod
    def of(cls, message: Message) -> "Usage":
        """The tokens that a reply says it took."""
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
    """Price of a model, None if it is not known."""
    return prices().get(model)


def check_budget(model: str, max_cost: float | None) -> None:
    """InputError if a budget cannot be kept for that model."""
    if max_cost is not None and not 0 < max_cost < float("inf"):
        raise InputError(f"--max-cost {max_cost} is not a positive number of US dollars")
    if max_cost is not None and price_of(model) is None:
        raise InputError(f"--max-cost: the price of {model} is not known; add a row to {PRICES}")


def most(text_bytes: int, price: Price, max_tokens: int) -> float:
    """More than a call can cost [USD]: every byte of it a token written to the cache, the longest answer."""
    return (text_bytes * price.cache_write + max_tokens * price.output) / MILLION


@dataclass(frozen=True, slots=True)
class ReservationLine:
    """A call that is under way."""

    reserved: str
    """Name of the reservation."""
    process: int
    """Id of the process that asks."""
    usd: float
    """The most that it can cost [USD]."""


@dataclass(frozen=True, slots=True)
class ReleaseLine:
    """A call that did not take place."""

    settles: str
    """Name of its reservation."""
    usd: float
    """Its cost: nothing [USD]."""


@dataclass(frozen=True, slots=True)
class ReplyLine:
    """A reply, and what it took."""

    settles: str
    """Name of its reservation; empty if it was kept from before."""
    sample: str
    """Id of the sample that needed it."""
    question: str
    model: str
    how: str
    """asked, batch or kept."""
    input_tokens: int
    output_tokens: int
    cache_write_tokens: int
    cache_read_tokens: int
    usd: float | None
    """Its cost [USD]; None where the model's price is not known."""
    digest: str = ""
    """Of what was asked, under which the reply is kept; empty in ledgers of earlier versions."""


LedgerLine: TypeAlias = ReservationLine | ReleaseLine | ReplyLine
"""A line of the ledger."""


@dataclass(frozen=True, slots=True)
class Spending:
    """Totals of a run; tokens and cost are those of the replies that were not kept from before."""

    models: tuple[str, ...]
    """Names, in alphabetical order."""
    asked: int
    """Replies asked for one at a time."""
    batch: int
    """Replies asked for in batches."""
    kept: int
    """Replies kept from before."""
    input_tokens: int
    """Neither written to nor read from the cache."""
    output_tokens: int
    cache_write_tokens: int
    cache_read_tokens: int
    usd: float | None
    """[USD]; None where a model's price is not known."""


@dataclass(frozen=True, slots=True)
class Ledger:
    """The lines of one run."""

    path: Path | None
    """None: nothing is written, and there is no budget."""
    max_cost: float | None = None
    sample: str = ""

    def reserve(self, model: str, question: str, size: int, max_tokens: int, factor: float = 1.0) -> str:
        """Set aside what a call of this size may cost at most, and name the reservation; BudgetError if too little
        is left."""
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
                    f"--max-cost {self.max_cost:g} USD: {taken:.4f} USD are spent or set aside, and the question "
                    f"{question!r} may cost up to {needed:.4f}; raise --max-cost to go on"
                )
            append(file, ReservationLine(name, os.getpid(), needed))
        return name

    def release(self, name: str) -> None:
        """The call did not take place."""
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
        """Write what a reply took; `how` is asked, batch or kept."""
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
    """Cost of replies [USD]; None where a model's price is not known."""
    known = [one.usd for one in replies if one.usd is not None]
    return round(sum(known, 0.0), 6) if len(known) == len(replies) else None


def in_words(total: Spending) -> str:
    """Totals for a person."""
    cost = "at an unknown price" if total.usd is None else f"{total.usd:.4f} USD"
    read = total.input_tokens + total.cache_write_tokens + total.cache_read_tokens
    return (
        f"{total.asked + total.batch} replies asked for, {total.kept} kept from before; {read} tokens in "
        f"({total.cache_read_tokens} from the cache), {total.output_tokens} out, {cost}"
    )


def read_lines(path: Path) -> list[LedgerLine]:
    """All lines; none if there is no ledger."""
    return [read_line(text) for text in path.read_text(encoding="utf-8").splitlines()] if path.is_file() else []


def read_line(text: str) -> LedgerLine:
    """One line, of the kind that its keys tell."""
    tree = json.loads(text)
    kind: type[LedgerLine] = ReservationLine if "reserved" in tree else ReplyLine if "how" in tree else ReleaseLine
    return kind(**{one.name: tree[one.name] for one in fields(kind) if one.name in tree})


@contextmanager
def locked(path: Path) -> Iterator[IO[str]]:
    """The ledger, open and ours."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield file


def append(file: IO[str], line: LedgerLine) -> None:
    """One line, at once."""
    file.write(json.dumps(object_to_json(line)) + "\n")
    file.flush()


def cost_by_reservation(file: IO[str]) -> dict[str, float]:
    """Cost by reservation: what is set aside until it is settled, then what was spent [USD]; what a process had set
    aside that is gone is free again."""
    file.seek(0)
    cost: dict[str, float] = {}
    for line in map(read_line, file):
        if isinstance(line, ReservationLine):
            cost[line.reserved] = line.usd if line.process == os.getpid() or is_alive(line.process) else 0.0
        else:
            cost[line.settles] = line.usd or 0.0
    return cost


def is_alive(process: int) -> bool:
    """Whether a process of this machine runs."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True

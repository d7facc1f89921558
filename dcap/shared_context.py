"""A change of the whole process that several threads need at the same time."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Generic, ParamSpec

P = ParamSpec("P")


class SharedContext(Generic[P]):
    """A context that the first user enters and the last one leaves; those between find what the first has set."""

    def __init__(self, context: Callable[P, AbstractContextManager[object]]) -> None:
        self._context = context
        self._lock, self._users, self._entered = threading.Lock(), 0, ExitStack()

    @contextmanager
    def __call__(self, *arguments: P.args, **named: P.kwargs) -> Iterator[None]:
        """Be in the context; the arguments of the first count."""
        with self._lock:
            if self._users == 0:
                self._entered.enter_context(self._context(*arguments, **named))
            self._users += 1
        try:
            yield
        finally:
            with self._lock:
                self._users -= 1
                if self._users == 0:
                    self._entered.close()

"""When Prefect may take a result from the cache: only while the record's artifact is sound, byte by byte."""

from typing import TYPE_CHECKING, Any

from dcap.scene.settings import cache_root
from dcap.scene.store.artifacts import Store
from tasks.runner.context import current_call
from tasks.runner.locks import FileLocks
from tasks.runner.records import usable_key

if TYPE_CHECKING:
    from prefect.cache_policies import CachePolicy

LOCKS_FOLDER = "locks"
"""Where samples that need the same thing wait for each other, below the folder of the cache."""


def verified_records() -> "CachePolicy":
    """The cache policy: the key of the deciders, or the next free name where that record's artifact is damaged.

    Prefect is imported on the first run, not before: planning needs no server and must not wait for it.
    """
    from prefect.cache_policies import CachePolicy
    from prefect.context import TaskRunContext

    class VerifiedRecords(CachePolicy):
        def compute_key(
            self,
            task_ctx: TaskRunContext,
            inputs: dict[str, Any],
            flow_parameters: dict[str, Any],
            **kwargs: Any,
        ) -> str | None:
            return usable_key(current_call().key, Store.default())[0]

    # serialisable: two samples that need the same room read it once, the second waits for the first
    return VerifiedRecords().configure(
        isolation_level="SERIALIZABLE", lock_manager=FileLocks(cache_root() / LOCKS_FOLDER)
    )

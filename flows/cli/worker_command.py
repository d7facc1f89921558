"""`dcap worker`."""

from typing import Annotated

import typer


def worker(
    limit: Annotated[int, typer.Option(min=1, max=64, help="Flow runs at a time.")] = 1,
) -> int:
    """Serve the pool of a Prefect server, own or $PREFECT_API_URL's, until interrupted."""
    from flows.worker import serve_pool

    serve_pool(limit, lambda line: print(f"{line}  (stop with Ctrl-C)", flush=True))
    return 0

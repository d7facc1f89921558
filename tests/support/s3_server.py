"""A server of the S3 protocol on this machine, as a team's store."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

import pytest


class S3:
    """A server and its buckets.

    url: where it listens.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._numbers = count()

    def bucket(self) -> str:
        """URL of a new bucket with a prefix."""
        import boto3

        name = f"bucket-{next(self._numbers)}"
        boto3.client("s3", endpoint_url=self.url).create_bucket(Bucket=name)
        return f"s3://{name}/team/dcap"


@contextmanager
def s3_server() -> Iterator[S3]:
    """A server with credentials that it takes in the environment; skips the test where its library is not installed."""
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
            patch.setenv("AWS_ACCESS_KEY_ID", "someone")
            patch.setenv("AWS_SECRET_ACCESS_KEY", "in-the-environment")
            patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
            patch.setenv("NO_PROXY", "127.0.0.1")
            yield S3(f"http://{host}:{port}")
    finally:
        server.stop()

"""A server of the S3 protocol on this machine, as a team's store."""

import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from uuid import uuid4

import boto3
import pytest
from moto.server import ThreadedMotoServer
from s3fs import S3FileSystem


class S3:
    """A server and its buckets.

    url: where it listens.
    """

    def __init__(self, url: str) -> None:
        self.url = url

    def bucket(self) -> str:
        """URL of a new bucket with a prefix."""
        name = f"bucket-{uuid4().hex}"
        boto3.client("s3", endpoint_url=self.url).create_bucket(Bucket=name)
        return f"s3://{name}/team/dcap"


@contextmanager
def s3_server() -> Iterator[S3]:
    """A server with nothing in it, and in the environment where it is and credentials that it takes. What moto keeps is
    the process', and so are the connections that s3fs keeps by their arguments, among which no address is."""
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    try:
        forget(f"http://{host}:{port}")
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
            patch.setenv("AWS_ACCESS_KEY_ID", "someone")
            patch.setenv("AWS_SECRET_ACCESS_KEY", "in-the-environment")
            patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
            patch.setenv("NO_PROXY", "127.0.0.1")
            yield S3(f"http://{host}:{port}")
    finally:
        server.stop()


def forget(url: str) -> None:
    """Let go of all buckets and connections."""
    urllib.request.urlopen(urllib.request.Request(f"{url}/moto-api/reset", method="POST")).close()
    S3FileSystem.clear_instance_cache()

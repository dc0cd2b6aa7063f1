"""An S3-compatible object store in a thread of this process, which Arrow's S3 client talks to."""

import contextlib
import os
from urllib.request import Request, urlopen

import pytest
from pyarrow import fs

KEY = {"AWS_ACCESS_KEY_ID": "tester", "AWS_SECRET_ACCESS_KEY": "not-a-secret", "AWS_REGION": "us-east-1"}


@contextlib.contextmanager
def object_store(monkeypatch, host="127.0.0.1"):
    """A store with an empty bucket `lab`, found by the environment; yields a function that ends it early."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer(host, 0, verbose=False)
    server.start()
    stopped = []

    def stop():
        if not stopped:
            stopped.append(True)
            server.stop()

    try:
        for name, value in {**KEY, "AWS_ENDPOINT_URL": "http://{}:{}".format(*server.get_host_and_port())}.items():
            monkeypatch.setenv(name, value)
        # Stores of one process share their content.
        urlopen(Request(f"{os.environ['AWS_ENDPOINT_URL']}/moto-api/reset", method="POST"))
        fs.FileSystem.from_uri("s3://lab?allow_bucket_creation=true")[0].create_dir("lab")
        yield stop
    finally:
        stop()


def upload(folder, url):
    """Copies a folder to a URL."""
    files, root = fs.FileSystem.from_uri(url)
    fs.copy_files(str(folder), root, fs.LocalFileSystem(), files)


def names_at(url):
    """The files at a URL, relative to it."""
    files, root = fs.FileSystem.from_uri(url)
    found = files.get_file_info(fs.FileSelector(root, recursive=True, allow_not_found=True))
    return sorted(info.path.removeprefix(f"{root}/") for info in found if info.is_file)

"""An object store of a user's own that several processes share: a folder of this machine behind puts and gets."""

import os
import uuid

import fsspec
from fsspec.implementations.local import LocalFileSystem


class Bucket(LocalFileSystem):
    """Objects at ``bucket:///any/path``; a put is whole, and may be asked to be the first."""

    protocol = "bucket"

    @classmethod
    def _strip_protocol(cls, path):
        return LocalFileSystem._strip_protocol(str(path).removeprefix("bucket://"))

    def pipe_file(self, path, value, mode="overwrite", **_):
        path = self._strip_protocol(path)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        if mode == "create":
            with open(path, "xb") as file:
                file.write(value)
            return
        temporary = f"{path}.{uuid.uuid4().hex}"
        with open(temporary, "wb") as file:
            file.write(value)
        os.replace(temporary, path)


fsspec.register_implementation("bucket", Bucket, clobber=True)

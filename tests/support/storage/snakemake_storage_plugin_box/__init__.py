"""A storage plugin of Snakemake for tests: `box://NAME` is a file of the folder `$BOX`."""

import os
import shutil
from pathlib import Path

from snakemake_interface_storage_plugins.io import IOCacheStorageInterface
from snakemake_interface_storage_plugins.storage_object import StorageObjectRead
from snakemake_interface_storage_plugins.storage_provider import (
    StorageProviderBase,
    StorageQueryValidationResult,
)

_BEGIN = "box://"


class StorageProvider(StorageProviderBase):
    @classmethod
    def example_queries(cls):
        return []

    @classmethod
    def is_valid_query(cls, query):
        return StorageQueryValidationResult(str(query), str(query).startswith(_BEGIN))

    def rate_limiter_key(self, query, operation):
        return None

    def default_max_requests_per_second(self):
        return 10.0

    def use_rate_limiter(self):
        return False


class StorageObject(StorageObjectRead):
    @property
    def _file(self):
        return Path(os.environ["BOX"], self.query.removeprefix(_BEGIN))

    async def inventory(self, cache: IOCacheStorageInterface):
        pass

    def get_inventory_parent(self):
        return None

    def local_suffix(self):
        return self.query.removeprefix(_BEGIN)

    def cleanup(self):
        pass

    def exists(self):
        return self._file.is_file()

    def mtime(self):
        return self._file.stat().st_mtime

    def size(self):
        return self._file.stat().st_size

    def retrieve_object(self):
        shutil.copy(self._file, self.local_path())

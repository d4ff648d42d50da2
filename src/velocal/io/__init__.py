"""Our own files: one writer, Parquet schemas, digests, what a script gets from its rule."""

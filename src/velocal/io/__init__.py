"""Files of our own: atomic writing, Parquet schemas, digests."""

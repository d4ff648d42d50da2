"""Bytes of one payload: data blocks and status bytes."""

"""Bytes of one payload: data blocks, firings, two returns of a shot, status bytes."""

"""Captures of a scanner: payloads out of files, a ledger of what was not used, rotations."""

"""Readers, writers and linter of calibration files: db.xml, YAML, and our own CSV and JSON."""

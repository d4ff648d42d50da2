"""Checks that find a wrong survey before anything is exported; see docs/survey-checks.md."""

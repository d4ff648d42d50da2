"""Faulty inputs of every kind, and what velocal does with each: `docs/reliability.md`."""

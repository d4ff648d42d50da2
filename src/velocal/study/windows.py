"""Windows of a recording, and a limit: what commands need without the whole configuration."""

from __future__ import annotations

#: Windows of a surveyed sample, and the only one of a sample without a survey.
WINDOWS = ("beginning", "middle", "end")
WHOLE = "all"
#: Largest share of its azimuth that a complete rotation may miss.
MAX_MISSING = 0.05

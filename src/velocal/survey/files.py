"""Survey files that a study is given: read whole before anything is planned."""

from __future__ import annotations

from pathlib import Path

from velocal.study.config import Coordinates
from velocal.study.study import Study
from velocal.survey.network.field_book import FILES, read_field_book
from velocal.survey.targets import read_targets

#: Column of `read_targets` in the files of coordinates, by their key in the configuration.
_GROUPS = {"planes": "plane", "base_scanner": "scanner", "base_site": "position"}


def check_survey(study: Study) -> None:
    """Check every value of the survey files that no rule makes.

    Without this, a wrong number would stop the run in a job, after the recordings were decoded.

    Parameters
    ----------
    study : Study
        Its files exist (`velocal.study.files.check_files`).

    Raises
    ------
    SurveyError
        For the first fault found.
    """
    made = study.made_files()
    if study.observations:
        # `ObservationFiles` and `FILES` have the same order.
        paths = dict(zip(FILES, study.observations.plain().values(), strict=True))
        if not made & {*paths.values()}:
            read_field_book({name: Path(path) for name, path in paths.items() if path})
    elif isinstance(study.config.survey, Coordinates):
        for key, path in study.config.survey.plain().items():
            read_targets(path, _GROUPS[key])

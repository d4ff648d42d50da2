"""Files beside the library that belong to it: the workflow, its scripts, the simulated world.

In a checkout they are in its top folder. In an installed package they are in the folder `shipped`
of the library, in the same arrangement; `hatch_build.py` puts them there.
"""

from __future__ import annotations

from pathlib import Path

from velocal.errors import ConfigError

_PACKAGE = Path(__file__).parents[1]
#: Where the files may be: in an installed package, and in a checkout.
PLACES = (_PACKAGE / "shipped", _PACKAGE.parents[1])


def shipped(name: str) -> Path:
    """Path of a file that comes with the library, wherever that is installed.

    Parameters
    ----------
    name : str
        Path in a checkout, such as ``workflow/Snakefile``.

    Returns
    -------
    Path
        Absolute.

    Raises
    ------
    ConfigError
        If it is neither in the installed package nor in a checkout.
    """
    for place in PLACES:
        if (place / name).is_file():
            return place / name
    raise ConfigError(
        f"the file {name!r} of velocal is missing",
        where=str(_PACKAGE),
        hint="The installation is not complete: install velocal again.",
    )

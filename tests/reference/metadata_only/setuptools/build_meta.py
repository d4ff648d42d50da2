"""Back end of a build that builds nothing.

pip asks the back end of a source distribution for its name and version before it downloads it.
The archives of `make nist` name `setuptools.build_meta`, which would run their code, and with
build isolation the newest setuptools, which no hash pins. `make nist` puts this module in its
place: it hands over the text of `PKG-INFO`, and can do nothing else.
"""

import re
from pathlib import Path


def prepare_metadata_for_build_wheel(
    metadata_directory: str, config_settings: dict[str, str] | None = None
) -> str:
    """Write the metadata of the archive in the current folder, and return the folder's name."""
    text = Path("PKG-INFO").read_text(encoding="utf-8")
    name, version = (re.search(rf"^{key}: (\S+)$", text, re.M)[1] for key in ("Name", "Version"))
    folder = f"{name}-{version}.dist-info"
    made = Path(metadata_directory, folder)
    made.mkdir()
    (made / "METADATA").write_text(text, encoding="utf-8")
    return folder

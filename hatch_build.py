"""What packages contain besides the library: the workflow and what it needs, and the commit.

Not `force-include` in `pyproject.toml`: an editable installation would get copies too.
"""

import runpy
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

#: Files and folders of the checkout that `velocal.study.shipped` finds in an installed package.
SHIPPED = ("workflow", "scripts", "config/schema", "config/world.yaml", "environment.yml")


class ShippedHook(BuildHookInterface):
    """Adds files to wheels and source distributions."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name the files; the note of the commit is written outside the checkout."""
        if version == "editable":
            return
        library = runpy.run_path(str(Path(self.root, "src/velocal/io/commit.py")))
        self.folder = tempfile.TemporaryDirectory()
        note = Path(self.folder.name, library["NAME"])
        note.write_text(library["commit_of"](Path(self.root)) + "\n", encoding="ascii")
        wheel = self.target_name == "wheel"
        within = "velocal/shipped/" if wheel else ""
        added = {str(note): within + note.name}
        added |= {str(Path(self.root, name)): within + name for name in SHIPPED if wheel}
        build_data["force_include"].update(added)

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the note after it has been packed."""
        if version != "editable":
            self.folder.cleanup()

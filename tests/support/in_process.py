"""Jobs of the workflow in this process: what a rule gives to its script, and what that writes.

The rules are loaded as Snakemake loads them; a job calls `main` of its script through the same
adapter as a real run. There are no processes, no logs and no metadata.

``python -m support.in_process FILE ...`` makes files of the project in the current folder.
"""

import contextlib
import importlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from snakemake.api import SnakemakeApi
from snakemake.iocontainers import Wildcards
from snakemake.settings.types import ConfigSettings, OutputSettings, Quietness, ResourceSettings

from velocal.io.scripts import calls


@dataclass
class Job:
    """What Snakemake gives to a script as the global name ``snakemake``."""

    rule: str
    script: str
    input: Any
    output: Any
    params: Any
    wildcards: Any
    log: tuple[str, ...] = ()

    def given(self) -> dict[str, str]:
        """Inputs and params as text, by name, as Snakemake compares them."""
        parts = {**dict(self.input.items()), **dict(self.params.items())}
        return {name: repr(value) for name, value in parts.items()}

    def run(self) -> None:
        """Call the script's `main`."""
        main = importlib.import_module(self.script).main
        for path in self.output:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
        for given in calls(main, self):
            main(**given)


class Rules:
    """Rules of a configuration.

    Parameters
    ----------
    folder : Path
        Copy of the project; also the current folder.
    config : dict
    """

    def __init__(self, folder: Path, config: dict[str, Any]):
        with SnakemakeApi(OutputSettings(quiet={Quietness.ALL})) as api:
            loaded = api.workflow(
                resource_settings=ResourceSettings(cores=1),
                config_settings=ConfigSettings(config=config),
                snakefile=folder / "workflow/Snakefile",
                workdir=folder,
            )
            self.rules = {rule.name: rule for rule in loaded._workflow.rules}
            self.order = loaded._workflow._ruleorder
            # Functions of the rules look names up here, and the next configuration writes there.
            self.globals = loaded._workflow.globals
            self.names = dict(self.globals)

    def job_of(self, path: str) -> Job:
        """Job that makes a file."""
        makers = [rule for rule in self.rules.values() if rule.is_producer(path)]
        assert makers, f"no rule makes {path}"
        # The rule that `ruleorder` puts first.
        maker = next(
            rule
            for rule in makers
            if not any(self.order.compare(rule, other) < 0 for other in makers)
        )
        return self.job(maker.name, **maker.get_wildcards(path))

    def job(self, name: str, **wildcards: str) -> Job:
        """Job of a rule."""
        self.globals.update(self.names)
        rule = self.rules[name]
        values = Wildcards(fromdict=wildcards)
        inputs = rule.expand_input(values)[0]
        outputs = rule.expand_output(values)[0]
        params = rule.expand_params(values, inputs, outputs, None)[0]
        return Job(name, Path(rule.script).stem, inputs, outputs, params, values)

    def make(self, path: str) -> None:
        """Make a file and everything that it is made of, unless it is there."""
        if Path(path).exists():
            return
        job = self.job_of(path)
        for needed in job.input:
            self.make(needed)
        job.run()


@contextlib.contextmanager
def put_aside(paths: list[str]) -> Iterator[None]:
    """Keep the bytes of files while others are written in their place."""
    kept = {path: Path(path).read_bytes() for path in map(str, paths) if Path(path).exists()}
    try:
        yield
    finally:
        for path, content in kept.items():
            Path(path).write_bytes(content)


if __name__ == "__main__":
    rules = Rules(Path.cwd(), yaml.safe_load(Path("config/config.yaml").read_text()))
    for name in sys.argv[1:]:
        rules.make(name)

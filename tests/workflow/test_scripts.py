"""Every rule and its script: the same names on both sides, and files below the results only."""

import importlib
import inspect
import re
from pathlib import Path

import pytest
from support.running import ROOT

from velocal.io.scripts import NOT_TAKEN, TRIGGERS, disagreements

RULES = sorted((ROOT / "workflow/rules").glob("*.smk"))


def faults(rule, main):
    names = {
        part: set(values.keys()) - NOT_TAKEN
        for part, values in (("input", rule.input), ("output", rule.output), ("param", rule.params))
    }
    return disagreements(main, names, rule.wildcard_names)


def main_of(name):
    return importlib.import_module(name).main


def written():
    """Names of rules in the text of all files of rules."""
    return re.findall(
        r"^ *(?:use rule \w+ as |rule |checkpoint )(\w+)(?: with)?:",
        "\n".join(path.read_text() for path in RULES),
        flags=re.MULTILINE,
    )


def test_all_rules_are_looked_at(study_rules):
    """A rule that only another configuration has would escape the next test."""
    assert set(study_rules) - {"all"} == set(written())
    assert len(written()) > 30


@pytest.mark.parametrize("name", written())
def test_rule_and_script_have_the_same_names(study_rules, name):
    rule = study_rules[name]
    assert faults(rule, main_of(Path(rule.script).stem)) == []


@pytest.mark.parametrize("name", written())
def test_nothing_comes_by_position(study_rules, name):
    for values in (study_rules[name].input, study_rules[name].output, study_rules[name].params):
        assert all(key is not None for key, _ in values._allitems())


def test_a_name_on_one_side_is_found(study_rules):
    rule = study_rules["adjust_survey"]

    def lacks(*, planes: Path, base_scanner: Path, base_field: Path, survey: Path) -> None: ...

    found = faults(rule, lacks)
    assert "main does not take the input 'covariance' of the rule" in found
    assert "main does not take the param 'names' of the rule" in found
    assert not any("position" in fault for fault in found)

    source = inspect.signature(main_of("adjust_survey"))
    more = source.parameters["scanner"].replace(name="colour")

    def main(**arguments): ...

    main.__signature__ = source.replace(parameters=[*source.parameters.values(), more])
    assert faults(rule, main) == ["the rule does not give 'colour', which main takes"]


def test_every_script_has_a_rule(study_rules):
    used = {Path(rule.script).name for rule in study_rules.values() if rule.script}
    assert used == {path.name for path in (ROOT / "scripts").glob("*.py")}


def test_every_script_runs_again_when_its_library_changes(study_rules):
    for rule in study_rules.values():
        assert set(rule.params.keys()) >= TRIGGERS if rule.script else rule.name == "all"


def test_every_job_is_measured(study_rules):
    for rule in study_rules.values():
        if rule.script:
            log = str(rule.log[0]).replace("/logs/", "/benchmarks/")
            assert f"{rule.benchmark}" == f"{log.removesuffix('.log')}.tsv"

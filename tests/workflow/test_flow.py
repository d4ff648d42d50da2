"""The drawing of the flow names the rules and the dependencies that the workflow has."""

import pytest
from snakemake.iocontainers import Wildcards

from velocal.reporting.figures.flow import HANDED_OVER, STEPS

WILDCARDS = {"sample": "sa3", "position": "P2", "scanner": "HDL-64E"}


def makers(rules, path):
    """Rules of the drawing that make a file; one rule is another with one more output."""
    found = {name for name, rule in rules.items() if rule.is_producer(path)}
    return {name.removesuffix("_with_calibration") for name in found}


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.rule)
def test_arrows_are_the_inputs_of_the_rule(study_rules, step):
    rule = study_rules[step.rule]
    drawn = {each.rule for each in STEPS}
    if step.rule in HANDED_OVER:
        assert not step.needs
        assert not step.also
        return
    given = Wildcards(fromdict={name: WILDCARDS[name] for name in rule.wildcard_names})
    inputs = rule.expand_input(given)[0]
    needed = set().union(*(makers(study_rules, path) for path in inputs)) & drawn
    assert needed == {*step.needs, *step.also}

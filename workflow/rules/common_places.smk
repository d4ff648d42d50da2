# Helpers of outdoor.smk and map.smk; no rules.

OUTDOOR = SETTINGS.outdoor
OUTDOOR_FIGURES = OUTDOOR.figures if OUTDOOR else {}


def outdoor_sample(wildcards):
    return STUDY.outdoor[wildcards.outdoor]


def outdoor_files():
    """What the study asks for."""
    return [
        *[f"{RESULTS}/outdoor/{n}.csv" for n in ("means", "summary") if STUDY.outdoor],
        *expand(
            f"{RESULTS}/figures/figure_{{number}}.{{suffix}}",
            number=OUTDOOR_FIGURES,
            suffix=("svg", "png", "csv"),
        ),
    ]


def at_positions(pattern, samples):
    return [
        expand(pattern, position=STUDY.samples[name].position)[0] for name in samples
    ]

# Lets `snakemake` run from the root of the checkout; everything is in workflow/.
include: "workflow/Snakefile"


# An included `all` would be only one of many rules: the default target has to be named here.
rule default:
    default_target: True
    input:
        rules.all.input,

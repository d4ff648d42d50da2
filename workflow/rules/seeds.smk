# The study for many seeds of the simulated world, in memory and at reduced cost: one seed alone may
# agree with the paper by chance.
#
# in:   config/world.yaml, the configuration
# out:  {results}/seeds/{seed}.csv       every entry beside the printed one, for one seed
#       {results}/seeds/agreement.csv    mean and spread of every entry over the seeds
#       {results}/seeds/constants.csv    constants of the world that would fit the tables better
#
# Not part of `all`; `make seeds` asks for it. The same functions as in the rest of the workflow run
# in one process a seed, on recordings with fewer rotations in a window.

SEEDS = SETTINGS.simulation.seeds if SETTINGS.simulation else None

if SEEDS:

    rule replicate_study:
        input:
            world_file=WORLD,
        output:
            agreement=f"{RESULTS}/seeds/{{seed}}.csv",
        log:
            f"{RESULTS}/logs/replicate_study/{{seed}}.log",
        params:
            config=SETTINGS.plain(),
            rotations=SEEDS.rotations,
        script:
            "../../scripts/replicate_study.py"

    rule summarise_seeds:
        input:
            replicas=expand(
                f"{RESULTS}/seeds/{{seed}}.csv", seed=range(1, SEEDS.count + 1)
            ),
        output:
            agreement=f"{RESULTS}/seeds/agreement.csv",
        log:
            f"{RESULTS}/logs/summarise_seeds.log",
        localrule: True
        params:
            seeds=list(range(1, SEEDS.count + 1)),
        script:
            "../../scripts/summarise_seeds.py"

    rule tune_world:
        input:
            world_file=WORLD,
        output:
            constants=f"{RESULTS}/seeds/constants.csv",
        log:
            f"{RESULTS}/logs/tune_world.log",
        params:
            config=SETTINGS.plain(),
            rotations=SEEDS.rotations,
            seeds=2,
            iterations=2,
        script:
            "../../scripts/tune_world.py"

# Figures of walls in plan: the test field, and the map of an interior.
#
# in:   medians, surveys, factory calibration; building of the simulated world
# out:  {results}/figures/figure_NN.{svg,png,csv}    of the kinds `plan` and `map`
#       {results}/map/recordings/{position}.bin      simulated, as those of the samples
#       {results}/map/base_map.csv                   base targets in the frame of the building
#       {results}/map/points.parquet                 all points, with the factory's calibration and
#                                                    with a parameter set
#       {results}/map/summary.csv                    how many points, thickness of walls
#
# The pose of every position is adjusted from the targets on the scanner's base, as in the test field.

PLANS, MAPS = figures_of("plan"), figures_of("map")


# For each plan: the files that it shows.
OF_PLANS = {
    "medians": [
        expand(f"{RESULTS}/medians/{{sample}}/middle.parquet", sample=each.samples)
        for each in PLANS.values()
    ],
    "surveys": [
        at_positions(f"{RESULTS}/survey/{{position}}.json", each.samples)
        for each in PLANS.values()
    ],
    "calibration": factory_paths([each.scanner for each in PLANS.values()]),
}


rule draw_plan:
    input:
        medians=grouped(OF_PLANS["medians"]),
        surveys=grouped(OF_PLANS["surveys"]),
        targets=SURVEY.planes if SURVEY else [],
        calibration=grouped(OF_PLANS["calibration"]),
    output:
        svg=figure_files(PLANS, ["svg"]),
        png=in_report("figure", "Figures", figure_files(PLANS, ["png"])),
        csv=figure_files(PLANS, ["csv"]),
    log:
        f"{RESULTS}/logs/draw_plan.log",
    params:
        taken=taken(**OF_PLANS),
        samples=[list(each.samples) for each in PLANS.values()],
        selection=[each.plain() for each in PLANS.values()],
        limits=lambda wildcards: STUDY.assignment.limits.plain(),
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_plan.py"


if MAPS:
    MAP_NUMBER, MAP = next(iter(MAPS.items()))
    PLACES = list(SIMULATED.building.positions)

    rule simulate_building:
        input:
            world_file=WORLD,
        output:
            recordings=expand(
                f"{RESULTS}/map/recordings/{{place}}.bin",
                place=PLACES,
            ),
            base=f"{RESULTS}/map/base_map.csv",
        log:
            f"{RESULTS}/logs/simulate_building.log",
        params:
            positions=PLACES,
        script:
            "../../scripts/simulate_building.py"

    rule map_building:
        input:
            recordings=rules.simulate_building.output.recordings,
            base_map=rules.simulate_building.output.base,
            base_scanner=SURVEY.base_scanner,
            calibration=factory_path(MAP.scanner),
            refined=f"{RESULTS}/parameter_sets/{MAP.scanner}/{MAP.set}.csv",
        output:
            points=f"{RESULTS}/map/points.parquet",
        log:
            f"{RESULTS}/logs/map_building.log",
        params:
            positions=PLACES,
            parameter_set=MAP.set,
            scanner=MAP.scanner,
        script:
            "../../scripts/map_building.py"

    rule draw_map:
        input:
            points=rules.map_building.output.points,
        output:
            svg=f"{RESULTS}/figures/figure_{MAP_NUMBER}.svg",
            png=f"{RESULTS}/figures/figure_{MAP_NUMBER}.png",
            csv=f"{RESULTS}/figures/figure_{MAP_NUMBER}.csv",
            summary=f"{RESULTS}/map/summary.csv",
        log:
            f"{RESULTS}/logs/draw_map.log",
        params:
            selection=MAP.plain(),
            simulated=bool(WORLD),
        script:
            "../../scripts/draw_map.py"
